"""Appearance vectors (embeddings) of detections, and the statistics of all vectors so far."""

from typing import ClassVar

from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.detection_vectors import DetectionVectors
from semantic_slam.viewpoint.embeddings.background import SeenVectors
from semantic_slam.viewpoint.embeddings.vectors import reduced

REMEMBERED = 4
"""Number of recent keyframes that may be read again."""


class VectorReader:
    """Reads the vectors of keyframes in order; they are reduced to ``dimensions`` (L) components."""

    STATE: ClassVar[tuple[str, ...]] = ("_size", "_seen")

    def __init__(self, dimensions: int) -> None:
        self._dimensions = dimensions
        self._size = 0  # F
        self._seen: dict[int, SeenVectors] = {-1: SeenVectors.none(dimensions)}  # after each keyframe

    def vectors(self, keyframe: Keyframe) -> DetectionVectors:
        """Vectors of all detections. Raises InputError if their length differs from that of earlier ones."""
        told = keyframe.measurements.embeddings
        if told.shape[1] and len(told):
            self._check(told.shape[1])
        vectors = reduced(told, self._dimensions)
        before = max(index for index in self._seen if index < keyframe.index)  # the newest keyframe may be read again
        seen = self._seen[before].with_vectors(vectors)
        kept = {index: own for index, own in self._seen.items() if keyframe.index - REMEMBERED < index < keyframe.index}
        self._seen = {**({before: self._seen[before]} | kept), keyframe.index: seen}
        return DetectionVectors(vectors=vectors, background=seen.background)

    def _check(self, size: int) -> None:
        if self._size and size != self._size:
            raise InputError(
                f"detections have embeddings of {size} components, before they had {self._size}; send those of one"
                " network alone"
            )
        self._size = size
