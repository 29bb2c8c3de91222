"""How many detection frames of a replay are done with, whoever dies in between."""

from collections import OrderedDict
from dataclasses import replace

from semantic_slam.errors import MessageError
from semantic_slam.perception.measurement import SemanticMeasurements

MOST_REMEMBERED = 1000
"""Frames: more than a replay goes back."""
MOST_AT_ONCE = 1000
"""Frames: more than a classifier loses before it tells."""


class FrameCount:
    """Counts the frames that were measured, and those that their classifier lost.

    A classifier that is started again goes over the last frames once more, and counts from zero what it drops.
    """

    def __init__(self, *, is_gapless: bool = False) -> None:
        """``is_gapless``: none of a classifier's measurements is lost on its way here."""
        self._is_gapless = is_gapless
        self.stamp_ns = 0  # of the newest frame measured
        self._num_measured = 0
        self._lost_before, self._lost = 0, 0  # by former classifiers, and by this one
        self._sequence = -1
        self._again_until_ns = 0  # a former classifier measured what comes up to here
        self._dropped: OrderedDict[int, int] = OrderedDict()  # as told with the last frames, by stamp
        self._dropped_before = 0  # by former classifiers

    def measured(self, measurements: SemanticMeasurements) -> SemanticMeasurements | None:
        """The measurements with what all classifiers dropped; None for a frame that a former one has measured.

        Raises MessageError where they are not the next ones of their classifier.
        """
        stamp_ns = measurements.stamp_ns
        if self._is_gapless and self._num_measured and not self._is_next(measurements):
            text = f"number {measurements.sequence} came after {self._sequence}"
            raise MessageError(f"measurements: {text}; somebody else sends them", "out of turn")
        if measurements.sequence <= self._sequence:
            self._again_until_ns, self._dropped_before = self.stamp_ns, self._dropped.get(self.stamp_ns, 0)
        self._sequence = measurements.sequence
        if stamp_ns <= self._again_until_ns:
            self._dropped_before = self._dropped.get(stamp_ns, self._dropped_before) - measurements.dropped
            return None
        self._again_until_ns = 0  # what lies before that from now on is of another session
        told = replace(measurements, dropped=measurements.dropped + self._dropped_before)
        self._num_measured += 1
        self.stamp_ns = stamp_ns
        self._dropped[stamp_ns] = told.dropped
        if len(self._dropped) > MOST_REMEMBERED:
            self._dropped.popitem(last=False)
        return told

    def _is_next(self, measurements: SemanticMeasurements) -> bool:
        """Whether they follow on the last ones, or begin anew with frames that were measured before."""
        is_again = measurements.sequence == 0 and measurements.stamp_ns <= self.stamp_ns
        return is_again or measurements.sequence == self._sequence + 1

    def lost(self, frames: int) -> None:
        """A classifier has told how many frames it lost so far. Raises MessageError for more than can be."""
        if frames - self._lost > MOST_AT_ONCE:
            raise MessageError(f"progress: {frames} frames were lost, after {self._lost}", "more than there can be")
        if frames < self._lost:
            self._lost_before += self._lost
        self._lost = frames

    def num_done(self, num_waiting: int) -> int:
        """Frames done with, where so many of those measured still wait."""
        return self._num_measured - num_waiting + self._lost_before + self._lost
