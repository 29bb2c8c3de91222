"""The process behind ``~/explain``: ``python -m semantic_slam.ros.services.explain_process PARENT FILE LENGTH OBJECT``.

It repeats the run's inference at low priority, while the manager continues the run. FILE is the file descriptor of the
kept keyframes, LENGTH the number of bytes to read; the newest belief is read from standard input, the answer is written
to standard output, an error as one line to standard error. It ends when the process PARENT ends.
"""

import os
import sys

import numpy as np

from semantic_slam.answers.explain.explanation import explanation_of
from semantic_slam.answers.explain.replayed_run import replay
from semantic_slam.answers.explain.text import lines_of
from semantic_slam.cli.exit_codes import run_main
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.pipeline.journal.kept_run import read_kept
from semantic_slam.ros.launching.processes import end_with

NICENESS = 10
"""Niceness of the process: the nodes have priority."""


def explained(descriptor: int, length: int, belief: bytes, object_id: int) -> list[str]:
    """Lines that ``semantic_slam explain`` prints for an object of the newest belief. Raises InputError."""
    run, keyframes = read_kept(descriptor, length)
    newest = decode(belief, topics.TYPES[topics.BELIEF])
    measurements = {keyframe.stamp_ns: keyframe.measurements for keyframe in keyframes}
    odometry = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))  # not used by an explanation
    record = Record(run, (newest,), odometry, measurements, None)
    return lines_of(explanation_of(record, replay(record, keyframes, [object_id]), object_id))


def command() -> None:
    """Read the arguments and the belief, infer, print; raises InputError."""
    parent, descriptor, length, object_id = map(int, sys.argv[1:])
    end_with(parent)
    os.nice(NICENESS)
    print("\n".join(explained(descriptor, length, sys.stdin.buffer.read(), object_id)))


if __name__ == "__main__":
    run_main(command)
