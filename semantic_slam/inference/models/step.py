"""One keyframe's input to the engine."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.detection_vectors import DetectionVectors
from semantic_slam.inference.models.detector_words import DetectorWords
from semantic_slam.inference.models.sensed_region import SensedRegion
from semantic_slam.inference.models.spatial.camera import Camera
from semantic_slam.inference.models.spatial.gravity import Gravity


@dataclass(frozen=True)
class Motion:
    """Odometry from one keyframe to the next."""

    control: Array  # (s,) relative robot pose
    covariance: Array  # (r, r)
    by_bias: Array | None = None  # (r, p) Jacobian of the control by odometry biases, where estimated
    shifts: Array | None = None  # (G, r) change by offsets of its clock, see ``clock_offset``, where estimated
    gravity: Gravity | None = None  # in space, measurement of the vertical at its end


@dataclass(frozen=True)
class AssociatedDetection:
    """A detection with the object and class that a hypothesis assigns to it; class -1: no semantics."""

    detection: Any
    object_id: int
    assigned_class: int
    number: int = 0  # index among its keyframe's detections with correlated errors
    width: float = 1.0  # of an outlier: its white error's standard deviation relative to an inlier's

    def as_outlier(self, width: float) -> "AssociatedDetection":
        """The detection as an outlier, with ``width`` times the white error."""
        return replace(self, detection=self.detection.widened(width), width=width)


@dataclass(frozen=True, kw_only=True)
class Step:
    """One keyframe: motion since the one before, and D detections."""

    index: int
    stamp_ns: int
    motion: Motion
    detections: Sequence[Any]  # D, for the observation model
    detection_ids: NDArray[np.uint32]  # (D,) index in the detector's message
    scores: Array  # (D,) detector's confidence
    names: tuple[str, ...]  # (D,) identities given, "" for none
    in_coverage: NDArray[np.bool_]  # (D,) whether the view lay inside the class models' coverage
    labels: tuple[str, ...] = ()  # (D,) of the detector; empty where nobody asks for them
    words: DetectorWords | None = None  # D, where labels are evidence of classes
    vectors: DetectionVectors | None = None  # D, where appearance is evidence
    sensed: SensedRegion | None = None  # where the sensor's region is learned from detections
    camera: Camera | None = None  # in space: camera that defines the sensor's region
    dropped: int = 0  # inputs not used so far
    free_range_scan: Array = field(
        default_factory=lambda: np.zeros((0, 2))
    )  # (B, 2) bearing, range of the farthest surface

    def observed(
        self, association: Sequence[int], classes: Sequence[int], used: Iterable[int]
    ) -> tuple[AssociatedDetection, ...]:
        """The detections ``used`` that a hypothesis associates with objects."""
        return tuple(
            AssociatedDetection(self.detections[i], association[i], classes[i]) for i in used if association[i] >= 0
        )
