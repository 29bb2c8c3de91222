"""Which poses on topic initialpose come early enough in a recording to be the start of its run."""

from collections.abc import Collection

from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.messages import topics
from semantic_slam.messages.standard import NANOSECONDS

TOLERANCE_NS = NANOSECONDS
"""A recorder subscribes to one topic after another, so a latched pose may come to it after the first frames."""


def start_deadline_ns(reader: BagReader, odometry: Collection[str], frames: Collection[str]) -> int | None:
    """Latest log time [ns] of a pose that is the start; None without odometry or frames, as there is no run then.

    A running system starts at a pose that it received before its first keyframe, which takes odometry and a frame. A
    later pose is the start of its next run, and a recording is one run.
    """
    first_odometry, first_frame = _first_ns(reader, odometry), _first_ns(reader, frames)
    if first_odometry is None or first_frame is None:
        return None
    return max(first_odometry, first_frame) + TOLERANCE_NS


def left_out_as_late(log_time_ns: int, deadline_ns: int) -> str:
    """One line on a pose that comes after the deadline, and its remedy."""
    late_s = (log_time_ns - (deadline_ns - TOLERANCE_NS)) / NANOSECONDS
    return (
        f"/{topics.INITIAL_POSE}: the pose of {log_time_ns / NANOSECONDS:.3f} s is not used, as it comes {late_s:.1f} s"
        " after odometry and detections have begun; set initial_pose in the configuration if the run starts there"
    )


def _first_ns(reader: BagReader, names: Collection[str]) -> int | None:
    """Log time of the first message on these topics; None without one."""
    try:
        first = next(reader.messages(names), None) if names else None
    except TruncatedBagError:  # the run reports the damage
        return None
    return None if first is None else first.stamp_ns
