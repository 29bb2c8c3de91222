"""Keyframes of a run in which the robot was likelier carried elsewhere than not."""

from collections.abc import Sequence
from typing import ClassVar

LIKELY = 0.5
"""Probability above which the robot is taken for carried."""

Spans = tuple[tuple[int, int], ...]
"""First and last keyframes."""


class CarriedSpans:
    """The runs of such keyframes so far."""

    STATE: ClassVar[tuple[str, ...]] = ("spans",)

    def __init__(self) -> None:
        self.spans: Spans = ()

    def note(self, keyframe: int, probability: float) -> None:
        """Take the probability after a keyframe, in the order of the keyframes."""
        if not probability > LIKELY:
            return
        if self.spans and self.spans[-1][1] == keyframe - 1:
            self.spans = (*self.spans[:-1], (self.spans[-1][0], keyframe))
        else:
            self.spans = (*self.spans, (keyframe, keyframe))


def spans_text(spans: Sequence[tuple[int, int]]) -> str:
    """Spans as they are read: ``12 to 40, 61``."""
    return ", ".join(f"{first} to {last}" if last > first else f"{first}" for first, last in spans)


def spans_of(text: str) -> Spans:
    """Spans from their text. Raises ValueError for any other."""
    ends = [[int(end) for end in part.split(" to ")] for part in text.split(", ")] if text else []
    return tuple((own[0], own[-1]) for own in ends)


NOT_AS_STATED = "the sensor is not as open_world says: ask semantic_slam doctor, or"
NOT_AS_LEARNED = (
    "the sensor is panned, or detects less often than open_world says: list lower values in"
    " open_world.detection_probabilities or detection_half_ranges_m, or"
)
"""Where the region is learned, doctor has nothing to compare it with."""


def carried_line(spans: Sequence[tuple[int, int]], *, learns_region: bool = False) -> str:
    """What a run says of them in the end, with the remedy."""
    one = len(spans) == 1 and spans[0][0] == spans[0][1]
    return (
        f"the robot was taken for carried elsewhere in keyframe{'' if one else 's'} {spans_text(spans)}; if nobody"
        f" lifted it, {NOT_AS_LEARNED if learns_region else NOT_AS_STATED} set revision.carried_probability: 0"
    )
