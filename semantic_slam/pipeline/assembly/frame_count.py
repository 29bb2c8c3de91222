"""Counts the processed detection frames of a replay, across restarts of the classifier."""

from collections import Counter, OrderedDict
from dataclasses import replace
from typing import ClassVar

from semantic_slam.errors import MessageError
from semantic_slam.messages import topics
from semantic_slam.perception.measurement import SemanticMeasurements

MOST_REMEMBERED = 1000
"""Frames remembered: more than a resumed replay sends again."""
MOST_AT_ONCE = 1000
"""Frames: more than a classifier can lose between two progress messages."""
DOWN = f"{topics.MEASUREMENTS}: came while the manager was down"
EARLIER = f"{topics.MEASUREMENTS}: came before the manager heard any"


class FrameCount:
    """Counts the frames that were measured and those that the classifier lost.

    A restarted classifier measures the last frames again, and its drop counts restart from zero.
    """

    STATE: ClassVar[tuple[str, ...]] = (
        "stamp_ns",
        "missed",
        "_was_down",
        "_hears_first",
        "_num_measured",
        "_lost_before",
        "_lost",
        "_refused",
        "_sequence",
        "_again_until_ns",
        "_dropped",
        "_dropped_before",
    )

    def __init__(self, *, is_gapless: bool = False) -> None:
        """``is_gapless``: the transport loses no measurements, so that sequence numbers must be consecutive."""
        self._is_gapless = is_gapless
        self.stamp_ns = 0  # of the newest frame measured
        self.missed: Counter[str] = Counter()  # frames measured before the first one heard, and while it was down
        self._was_down = False  # since the last frame
        self._hears_first = True  # no frame was heard yet, of no session
        self._num_measured = 0
        self._lost_before, self._lost = 0, 0  # by previous classifiers, and by the current one
        self._refused = 0  # the newest number that was refused as more than can be lost at once
        self._sequence = -1
        self._again_until_ns = 0  # frames up to this stamp were already measured by a previous classifier
        self._dropped: OrderedDict[int, int] = OrderedDict()  # total dropped counts of the last frames, by stamp
        self._dropped_before = 0  # by previous classifiers

    def measured(self, measurements: SemanticMeasurements) -> SemanticMeasurements | None:
        """The measurements with the drop count of all classifiers; None if a previous classifier measured the frame.

        Raises MessageError if the sequence number is not the next one, with ``is_gapless``.
        """
        stamp_ns = measurements.stamp_ns
        if self._is_gapless and self._num_measured and not self._is_next(measurements):
            text = f"number {measurements.sequence} came after {self._sequence}"
            raise MessageError(f"measurements: {text}; somebody else sends them", "out of turn")
        self._count_missed(measurements.sequence)
        if measurements.sequence <= self._sequence:
            self._again_until_ns, self._dropped_before = self.stamp_ns, self._dropped.get(self.stamp_ns, 0)
        self._sequence = measurements.sequence
        if stamp_ns <= self._again_until_ns:
            self._dropped_before = self._dropped.get(stamp_ns, self._dropped_before) - measurements.dropped
            return None
        self._again_until_ns = 0  # from now on earlier stamps belong to another session
        told = replace(measurements, dropped=measurements.dropped + self._dropped_before)
        self._num_measured += 1
        self.stamp_ns = stamp_ns
        self._dropped[stamp_ns] = told.dropped
        if len(self._dropped) > MOST_REMEMBERED:
            self._dropped.popitem(last=False)
        return told

    def interrupted(self) -> None:
        """Note that the manager was down, so that the next sequence number tells how many frames it missed."""
        self._was_down = True

    def anew(self) -> "FrameCount":
        """Count of another session, in which the classifier may go on with its numbers."""
        other = FrameCount(is_gapless=self._is_gapless)
        other._hears_first = False
        return other

    def _count_missed(self, sequence: int) -> None:
        if self._hears_first and not self._is_gapless and sequence:
            self.missed[EARLIER] += sequence
        self._hears_first = False
        if self._was_down and self._num_measured:
            is_same_classifier = sequence > self._sequence
            self.missed[DOWN] += sequence - (self._sequence + 1 if is_same_classifier else 0)
        self._was_down = False

    def _is_next(self, measurements: SemanticMeasurements) -> bool:
        """Whether the sequence number is the next one, or restarts at 0 with a frame that was measured before."""
        is_again = measurements.sequence == 0 and measurements.stamp_ns <= self.stamp_ns
        return is_again or measurements.sequence == self._sequence + 1

    def lost(self, frames: int) -> None:
        """Set how many frames the classifier has lost so far.

        Raises MessageError for a number that is implausibly far above the one before, which may be somebody else's. The
        next one is believed if it goes on from there: who starts late hears a high number first.
        """
        goes_on = 0 <= frames - self._refused <= MOST_AT_ONCE
        if frames - self._lost > MOST_AT_ONCE and not goes_on:
            self._refused = frames
            raise MessageError(f"progress: {frames} frames were lost, after {self._lost}", "more than there can be")
        if frames < self._lost:
            self._lost_before += self._lost
        self._lost = frames

    def num_done(self, num_waiting: int) -> int:
        """Number of processed frames, given how many measured ones still wait."""
        return self._num_measured - num_waiting + self._lost_before + self._lost
