"""Check of stamps: backward steps, jumps, repetitions, and gaps of odometry."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, Severity, error, warning
from semantic_slam.doctor.input_summary import InputSummary, Stamps
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.stamps.topic_clock import AHEAD, BACKWARDS, LEAP_STEPS, SET_BACK, TopicClock

NAME = "stamps"
LEAST_GAP_S = 1.0
MANY = 0.01
"""Share of a topic's messages from which on lost ones are an error."""
REMEDIES = {
    SET_BACK: "the publisher or the simulation began anew: cut the recording there, or start the nodes anew",
    BACKWARDS: "have one publisher alone stamp its messages as they are made, and play a bag once",
    AHEAD: "look for a second publisher, or a clock that is set while it runs",
    "stamp repeats": "have one publisher alone stamp each message with its own time",
}


def check(summary: InputSummary) -> Iterator[Finding]:
    for topic, stamps in summary.stamps.items():
        if topic not in (summary.found.camera_info, summary.found.identities) and len(stamps):
            yield from _of_topic(topic, stamps)
    yield from _gaps(summary.found.odometry, summary.stamps_of(summary.found.odometry))


def _of_topic(topic: str, stamps: Stamps) -> Iterator[Finding]:
    if not stamps.header_ns.any():
        yield error(NAME, f"{topic}: all {len(stamps)} stamps are zero", "have its publisher fill header.stamp")
        return
    for reason, count in refused(stamps).items():
        severity = Severity.ERROR if reason == SET_BACK or count > MANY * len(stamps) else Severity.WARNING
        at = f", first at {_first_step_back(stamps):.3f} s" if reason in (BACKWARDS, SET_BACK) else ""
        what = f"{topic}: {reason.partition(';')[0]} ({count} of {len(stamps)} messages are not used{at})"
        yield Finding(severity, NAME, what, REMEDIES[reason])


def refused(stamps: Stamps) -> Counter[str]:
    """How many messages the pipeline refuses for their stamps, by reason."""
    dropped: Counter[str] = Counter()
    clock: TopicClock[None] = TopicClock("", dropped)
    for stamp_ns in stamps.header_ns.tolist():
        clock.take(stamp_ns, None)
    return Counter({reason.removeprefix(": "): count for reason, count in dropped.items()})


def _first_step_back(stamps: Stamps) -> float:
    back = np.flatnonzero(np.diff(stamps.header_ns) < 0)
    return float(stamps.header_ns[back[0] + 1 if len(back) else 0] / NANOSECONDS)


def _gaps(topic: str, stamps: Stamps) -> Iterator[Finding]:
    steps_s = np.diff(stamps.header_ns) / NANOSECONDS
    if len(steps_s) < LEAP_STEPS or (steps_s < 0.0).any():
        return
    usual, longest = float(np.median(steps_s)), int(np.argmax(steps_s))
    if steps_s[longest] > max(LEAST_GAP_S, LEAP_STEPS * usual):
        number = int((steps_s > max(LEAST_GAP_S, LEAP_STEPS * usual)).sum())
        yield warning(
            NAME,
            f"{topic} is missing for {steps_s[longest]:.1f} s from {stamps.header_ns[longest] / NANOSECONDS:.3f} s on"
            f" (usually {usual:.3g} s; {number} such gaps)",
            "look for dropped messages; motion across a gap counts as uncertain",
        )
