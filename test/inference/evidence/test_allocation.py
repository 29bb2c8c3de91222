"""Freed memory stays with the process: the system is not asked for its pages again."""

import platform
import resource

import numpy as np
import pytest

from semantic_slam.inference.evidence.allocation import keep_freed_memory


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the switch is glibc's")
def test_pages_of_freed_arrays_are_not_faulted_in_again() -> None:
    assert keep_freed_memory()

    def faults_of(batches: int) -> int:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(batches):
            together = [np.ones(2**19) for _ in range(4)]  # 4 MiB each
            del together
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    pages = 4 * 2**22 // resource.getpagesize()
    faults_of(2)
    assert faults_of(10) < pages
