"""Diagnostic statuses of a node, whose messages name the topic, the label or the backend concerned."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from math import isnan
from tempfile import gettempdir

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.evidence.model_fit import UNEXPLAINED, WINDOW_KEYFRAMES
from semantic_slam.inference.relocation.carried_spans import Spans, spans_text
from semantic_slam.messages import topics
from semantic_slam.messages.node_status import CARRIED_IN

SILENT_AFTER_S = 3.0
WAITING = "waiting for"


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Status:
    """One diagnostic status of a node."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


class InputMonitor:
    """Monitors the activity of one input topic; times are seconds of a steady clock."""

    def __init__(self, topic: str, now_s: float) -> None:
        self.topic = topic
        self.count = 0
        self._last_s = now_s

    def arrived(self, now_s: float) -> None:
        self.count += 1
        self._last_s = now_s

    def status(self, now_s: float, num_publishers: int) -> Status:
        """Status of the topic: receiving, waiting or silent, with the remedy."""
        name = f"input {self.topic}"
        values = {"messages": str(self.count), "publishers": str(num_publishers)}
        silent_s = now_s - self._last_s
        if silent_s < SILENT_AFTER_S:
            return Status(name, Level.OK, "receiving" if self.count else f"{WAITING} {self.topic}", values)
        if self.count:
            return Status(name, Level.WARN, f"{self.topic} has been silent for {silent_s:.0f} s", values)
        remedy = "it has a publisher that sends nothing" if num_publishers else "start its publisher or remap the topic"
        return Status(name, Level.ERROR, f"{self.topic} is silent: no message so far; {remedy}", values)


def console_text(statuses: Iterable[Status]) -> str:
    """Console text on a node's problems and the inputs it waits for; "" if there are none."""
    return "; ".join(
        status.message for status in statuses if status.level != Level.OK or status.message.startswith(WAITING)
    )


def dropped_status(dropped: Counter[str]) -> Status:
    """Status with the counts, by reason, of inputs not used and hypotheses dropped."""
    if not dropped:
        return Status("dropped", Level.OK, "nothing dropped")
    text = "; ".join(f"{number} x {reason}" for reason, number in sorted(dropped.items()))
    return Status("dropped", Level.WARN, text, {f"dropped: {reason}": str(n) for reason, n in sorted(dropped.items())})


def transforms_status(lack: str, moving: InputMonitor, now_s: float) -> Status:
    """Status of odometry from /tf; ``lack``: what that lacks and has instead, "" once it was there.

    ``moving`` monitors the transform itself: others on /tf may go on when it stops.
    """
    if not lack:
        told = moving.status(now_s, num_publishers=0)
        return Status("odometry", told.level, "comes by /tf" if told.level == Level.OK else told.message)
    remedy = "name the frames with odom_frame and base_frame, which has to be perception.base_frame"
    return Status("odometry", Level.WARN, f"/tf lacks {lack}; {remedy}")


def waiting_status(num_waiting: int) -> Status:
    """Status of messages of detections whose boxes are rays only once camera_info is known."""
    if not num_waiting:
        return Status("boxes", Level.OK, f"none wait for {topics.CAMERA_INFO}")
    text = f"{num_waiting} x {topics.DETECTIONS} with boxes that wait for {topics.CAMERA_INFO}"
    return Status("boxes", Level.WARN, f"{text}; start its publisher or remap the topic, or leave such boxes out")


def disk_status(fault: str) -> Status:
    """Status of keeping keyframes on disk; ``fault``: the system's error message, "" if there is none."""
    if not fault:
        return Status("disk", Level.OK, "keyframes can be kept on disk")
    folder = gettempdir()
    return Status(
        "disk",
        Level.WARN,
        f"keyframes stay in memory, which grows: {folder} takes no more ({fault});"
        " free space there, or name another folder by TMPDIR, and start this node again",
        {"folder": folder, "fault": fault},
    )


def rebuilt_status(num_rebuilt: int, num_replayed: int, faults: Counter[str]) -> Status:
    """Status of rebuilding components; ``faults``: what went wrong with checkpoints in files, by reason."""
    text = f"{num_rebuilt} components rebuilt, {num_replayed} keyframes replayed"
    values = {"components rebuilt": str(num_rebuilt), "keyframes replayed": str(num_replayed)}
    if not faults:
        return Status("checkpoints", Level.OK, text, values)
    told = "; ".join(f"{number} x {reason}" for reason, number in sorted(faults.items()))
    return Status("checkpoints", Level.WARN, f"checkpoints in files that are not used: {told}; {text}", values)


def repeated_status(repeated: Counter[str]) -> Status:
    """Status with the counts of repeated messages, by topic; they are normal after a restart."""
    repeated = +repeated  # without topics of which nothing came again
    text = "; ".join(f"{number} x {topic}" for topic, number in sorted(repeated.items())) or "nothing came again"
    return Status("repeated", Level.OK, text, {f"repeated: {topic}": str(n) for topic, n in sorted(repeated.items())})


def model_fit_status(belief: HybridBelief | None, carried: float = 0.0, spans: Spans = ()) -> Status:
    """Whether the newest belief explains its data; ``carried``: probability that the robot was kidnapped recently.

    ``spans``: the keyframes so far in which it was taken for that.
    """
    if belief is None:
        return Status("explanation", Level.OK, "no keyframe so far")
    names = ("log_evidence", "innovation_nees", "unexplained", "discarded_mass_window")
    values = {name: f"{getattr(belief, name):.4g}" for name in names} | {"carried": f"{carried:.4g}"}
    values |= {CARRIED_IN: spans_text(spans)} if spans else {}
    if carried > UNEXPLAINED:
        text = f"the robot was carried elsewhere lately ({carried:.0%}); see that the pose is where it stands"
        return Status("explanation", Level.WARN, text, values)
    if isnan(belief.unexplained):
        return Status(
            "explanation",
            Level.WARN,
            f"it is not known whether the belief explains its data at keyframe {belief.keyframe}: the evidence of one"
            f" of the last {WINDOW_KEYFRAMES} keyframes is not a number; do not trust its pose and its map meanwhile",
            values,
        )
    if belief.unexplained <= UNEXPLAINED:
        return Status("explanation", Level.OK, "the belief explains its data", values)
    return Status(
        "explanation",
        Level.WARN,
        f"the belief cannot explain its data at keyframe {belief.keyframe}; do not trust its pose and its map",
        values,
    )


def incompatible_status(topic: str, policy: str) -> Status:
    """Status for a publisher whose QoS is incompatible with our subscription."""
    return Status(
        f"QoS {topic}",
        Level.ERROR,
        f"{topic} has a publisher with an incompatible {policy}; publish it RELIABLE, or set lossless to false",
    )
