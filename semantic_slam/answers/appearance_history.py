"""Appearances of the objects of a run that still goes on, from its beliefs and measurements so far."""

from dataclasses import replace
from threading import Lock

import numpy as np

from semantic_slam.answers.appearances import Appearances, appearances_of, seen_views
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.geometry.optional_arrays import left_out
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.perception.measurement import SemanticMeasurements

WINDOW, CHUNK = 400, 25
"""Keyframes that are kept as they are, and how many older ones are then summarised at once."""


class AppearanceHistory:
    """Vectors of a run's detections, and which object each of them shows under every live hypothesis.

    One thread may add while another asks. Nothing is kept before the first vector; from then on a keyframe costs its
    vectors, and for each hypothesis a pose and the associations. Older keyframes than the window are summarised:
    associated as the best hypothesis had them then, seen from where it had robot and objects then. Of an object a view
    from each side is kept.
    """

    def __init__(self, settings: SemanticModelConfiguration, *, window: int = WINDOW, chunk: int = CHUNK) -> None:
        self._settings, self._window, self._chunk = settings, window, chunk
        self._lock = Lock()
        self._beliefs: list[HybridBelief] = []
        self._measurements: dict[int, SemanticMeasurements] = {}  # by stamp, of ``_beliefs``
        self._older: Appearances | None = None  # what older keyframes say
        self._fault = ""  # why they cannot be summarised
        self._built: tuple[int, Appearances] | None = None  # newest keyframe, and what all say
        self._first: int | None = None  # keyframe added first: 0, or that from which a restarted manager went on

    @property
    def num_keyframes(self) -> int:
        """Number of keyframes that are kept as they are."""
        return len(self._beliefs)

    def add(self, belief: HybridBelief, measurements: SemanticMeasurements) -> None:
        """Add a keyframe: the belief after it, and its measurements."""
        has_vectors = bool(np.isfinite(measurements.embeddings).any())
        with self._lock:
            self._first = belief.keyframe if self._first is None else self._first
            if has_vectors:
                self._measurements[belief.stamp_ns] = _vectors_of(measurements)
            if self._measurements or self._older is not None:
                self._beliefs.append(_associations_of(belief))
            if len(self._beliefs) >= self._window + self._chunk:
                self._summarise()

    def _summarise(self) -> None:
        """Summarise the oldest chunk; if two networks' vectors are mixed, what is asked from then on is refused."""
        oldest = {
            own.stamp_ns: self._measurements.pop(own.stamp_ns)
            for own in self._beliefs[: self._chunk]
            if own.stamp_ns in self._measurements
        }
        views, others = seen_views(self._beliefs, oldest)
        try:
            if views or self._older is not None:
                self._older = Appearances.of(views, others, self._settings, self._older)
        except InputError as fault:
            self._fault = str(fault)
        self._beliefs = self._beliefs[self._chunk :]

    def appearances(self) -> Appearances:
        """Appearance of each object: exact as :func:`appearances_of` for keyframes in the window, summarised for older.

        Raises InputError without vectors, or where the manager was restarted and earlier ones are lost.
        """
        with self._lock:
            beliefs, measurements = list(self._beliefs), dict(self._measurements)
            older, built, fault = self._older, self._built, self._fault
        if fault:
            raise InputError(fault)
        if self._first:
            raise InputError(
                f"vectors of appearance before keyframe {self._first} are not known since the manager was restarted;"
                " ask its recording: semantic_slam find --vector"
            )
        if not beliefs:
            raise InputError(
                "no detection of this run has a vector of appearance; let the detector send embeddings (DetectionArray)"
            )
        if built is None or built[0] != beliefs[-1].keyframe:
            built = beliefs[-1].keyframe, appearances_of(beliefs, measurements, self._settings, older)
            with self._lock:
                self._built = built
        return built[1]


def _vectors_of(measurements: SemanticMeasurements) -> SemanticMeasurements:
    """The measurements without what a classifier and a depth image add."""
    rows = len(measurements)
    return replace(
        measurements,
        class_probability_samples=np.zeros((rows, 0, 0)),
        features=np.zeros((rows, 0)),
        feature_covariances=np.zeros((rows, 0, 0)),
        free_range_scan=np.zeros((0, 2)),
        free_ranges_m=left_out(),
    )


def _associations_of(belief: HybridBelief) -> HybridBelief:
    """The belief without what takes most room and says nothing of associations: class tables and covariances."""
    hypotheses, objects = len(belief.hypothesis_ids), len(belief.object_ids)
    return replace(
        belief,
        class_names=(),
        pose_covariances=np.zeros((hypotheses, 0, 0)),
        hypothesis_class_probabilities=np.zeros((hypotheses, objects, 0)),
        class_probabilities=np.zeros((objects, 0)),
        object_covariances=np.zeros((objects, 0, 0)),
        descriptors=np.zeros((objects, 0)),
        descriptor_covariances=np.zeros((objects, 0)),
    )
