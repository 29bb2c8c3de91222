"""Tasks of a study in processes of their own, or in one for all of them."""

import os

import pytest
from semantic_slam_lab.repetitions import apart

OWN = "/proc/self"
"""A link to another place for every process."""


@pytest.mark.parametrize(("shared", "processes"), [(False, 3), (True, 1)])
def test_tasks_have_a_process_each_unless_they_share_one(shared: bool, processes: int) -> None:
    names = apart(os.path.realpath, [OWN] * 3, 1, "tasks", shared=shared)
    assert len(names) == 3 and len(set(names)) == processes
    assert os.path.realpath(OWN) not in names
