"""Tasks of a study in processes of their own, or in some for all of them."""

import os

from semantic_slam_lab.repetitions import apart

OWN = "/proc/self"
"""A link to another place for every process."""


def processes_of(jobs: int, *, shared: bool) -> set[str]:
    names = apart(os.path.realpath, [OWN] * 3, jobs, "tasks", shared=shared)
    assert len(names) == 3
    return set(names)


def test_tasks_have_a_process_each_unless_they_share_some() -> None:
    here = os.path.realpath(OWN)
    each, some = processes_of(1, shared=False), processes_of(2, shared=True)
    assert len(each) == 3 and len(some) <= 2
    assert here not in each | some
    assert processes_of(1, shared=True) == {here}
