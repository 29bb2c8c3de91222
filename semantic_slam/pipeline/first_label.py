"""Holds keyframes back in a live run until the first detection makes the detector's labels known."""

from collections.abc import Iterable
from typing import ClassVar

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.detector_labels import labels_of

MOST_WAITING = 1000
"""Maximum number of keyframes held back; further measurements without a label make no keyframe."""


class FirstLabel:
    """Holds keyframes back until one has labels, if the run's classes are the detector's labels.

    The run then starts with the same keyframe as if the labels had been known from the start. With
    ``semantic_model.labels`` configured, nothing is held back.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_is_awaited", "_waiting", "labels")

    def __init__(self, settings: SemanticModelConfiguration) -> None:
        self._is_awaited = class_model_kind(settings).labels is not None and not settings.labels
        self._waiting: list[Keyframe] = []
        self.labels: frozenset[str] = frozenset()  # of the first keyframe that had any

    @property
    def num_waiting(self) -> int:
        """Number of keyframes held back."""
        return len(self._waiting)

    def passes_over(self, measurements: SemanticMeasurements) -> bool:
        """Whether measurements must not become a keyframe because too many wait; the next one includes their motion."""
        return self.num_waiting >= MOST_WAITING and self._says_nothing(measurements)

    def released(self, keyframes: Iterable[Keyframe], *, at_end: bool = False) -> list[Keyframe]:
        """Keyframes that may be used, in order; ``at_end``: all of them, since no more labels will arrive."""
        self._waiting += keyframes
        if not at_end and all(self._says_nothing(keyframe.measurements) for keyframe in self._waiting):
            return []
        found, self._waiting = self._waiting, []
        if self._is_awaited:
            self.labels = next(filter(None, (labels_of(keyframe.measurements) for keyframe in found)), frozenset())
            self._is_awaited = False
        return found

    def _says_nothing(self, measurements: SemanticMeasurements) -> bool:
        """Whether there are no detections and no labels; a detection without label shows that its detector has none."""
        return self._is_awaited and not len(measurements) and not labels_of(measurements)
