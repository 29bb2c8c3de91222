"""Backends in processes of their own: the same belief, and one clear line where such a process is lost."""

import os
import signal

import pytest
from worlds.drives.drifted_return import open_world, return_with_drift
from worlds.same_beliefs import assert_same

from semantic_slam import Engine, Keyframe
from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.processes.process_pool import ProcessPool

pytestmark = pytest.mark.slow

REVISED = {"every_keyframes": 1}


@pytest.mark.long
def test_the_belief_is_bit_for_bit_that_of_backends_in_this_process() -> None:
    _, here = return_with_drift(REVISED)
    with ProcessPool(2) as pool:
        _, there = return_with_drift(REVISED, pool)
    assert sum(len(belief.revised_ids) for belief in there) > 0
    for ours, theirs in zip(there, here, strict=True):
        assert_same(ours, theirs)


def test_what_a_backend_raises_is_raised_here() -> None:
    with ProcessPool(1) as pool:
        Engine.of_run(Engine(open_world({})).run, pool)
        with pytest.raises(SemanticSlamError, match="keyframe 0 is missing; start the run again"):
            pool.expand(Keyframe.planar(1))


def test_a_process_that_is_killed_is_named_with_a_remedy() -> None:
    with ProcessPool(1) as pool:
        engine = Engine.of_run(Engine(open_world({})).run, pool)
        os.kill(pool.processes[0].process_id, signal.SIGKILL)
        with pytest.raises(SemanticSlamError, match=r"backend 0 ended with exit code -9; .*--processes 1"):
            engine.process(Keyframe.planar(0))


def test_no_process_is_left() -> None:
    with ProcessPool(2) as pool:
        numbers = [process.process_id for process in pool.processes]
    for number in numbers:
        with pytest.raises(ProcessLookupError):
            os.kill(number, 0)
