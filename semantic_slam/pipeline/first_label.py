"""Live, nobody knows what a detector can say before it says something: until then keyframes wait."""

from collections.abc import Iterable

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.detector_labels import labels_of

MOST_WAITING = 1000
"""Keyframes that wait at most; what comes after them and names nothing either is passed over."""


class FirstLabel:
    """Holds keyframes without a detection back until one names labels, where these are the classes of the run.

    So the run begins with the keyframe that it began with if the labels had been known. With
    ``semantic_model.labels`` nothing waits.
    """

    def __init__(self, settings: SemanticModelConfiguration) -> None:
        self._is_awaited = class_model_kind(settings).labels is not None and not settings.labels
        self._waiting: list[Keyframe] = []
        self.labels: frozenset[str] = frozenset()  # those that were first named

    @property
    def num_waiting(self) -> int:
        """Keyframes that are held back."""
        return len(self._waiting)

    def passes_over(self, measurements: SemanticMeasurements) -> bool:
        """Whether measurements are to make no keyframe, since as many wait as may; their motion is the next one's."""
        return self.num_waiting >= MOST_WAITING and self._says_nothing(measurements)

    def released(self, keyframes: Iterable[Keyframe], *, at_end: bool = False) -> list[Keyframe]:
        """The keyframes that may be used, in order; ``at_end`` all of them, since nothing will be named any more."""
        self._waiting += keyframes
        if not at_end and all(self._says_nothing(keyframe.measurements) for keyframe in self._waiting):
            return []
        found, self._waiting = self._waiting, []
        if self._is_awaited:
            self.labels = next(filter(None, (labels_of(keyframe.measurements) for keyframe in found)), frozenset())
            self._is_awaited = False
        return found

    def _says_nothing(self, measurements: SemanticMeasurements) -> bool:
        """Detections without a label do say something: that their detector names none."""
        return self._is_awaited and not len(measurements) and not labels_of(measurements)
