"""Appearances of the objects of a run that still goes on, from its beliefs and measurements so far."""

from dataclasses import replace
from threading import Lock

import numpy as np

from semantic_slam.answers.appearances import Appearances, appearances_of
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.geometry.optional_arrays import left_out
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.perception.measurement import SemanticMeasurements


class AppearanceHistory:
    """Vectors of a run's detections, and which object each of them shows under every live hypothesis.

    One thread may add while another asks. Nothing is kept before the first vector; from then on a keyframe costs its
    vectors, and for each hypothesis a pose and the associations.
    """

    def __init__(self, settings: SemanticModelConfiguration) -> None:
        self._settings = settings
        self._lock = Lock()
        self._beliefs: list[HybridBelief] = []
        self._measurements: dict[int, SemanticMeasurements] = {}  # by stamp
        self._built: tuple[int, Appearances] | None = None  # number of keyframes, and what they say
        self._first: int | None = None  # keyframe added first: 0, or that from which a restarted manager went on

    def add(self, belief: HybridBelief, measurements: SemanticMeasurements) -> None:
        """Add a keyframe: the belief after it, and its measurements."""
        has_vectors = bool(np.isfinite(measurements.embeddings).any())
        with self._lock:
            self._first = belief.keyframe if self._first is None else self._first
            if has_vectors:
                self._measurements[belief.stamp_ns] = _vectors_of(measurements)
            if self._measurements:
                self._beliefs.append(_associations_of(belief))

    def appearances(self) -> Appearances:
        """What the objects look like, as :func:`appearances_of` the whole run.

        Raises InputError without vectors, or where the manager was restarted and those before are not known any more.
        """
        with self._lock:
            beliefs, measurements, built = list(self._beliefs), dict(self._measurements), self._built
        if self._first:
            raise InputError(
                f"vectors of appearance before keyframe {self._first} are not known since the manager was restarted;"
                " ask its recording: semantic_slam find --vector"
            )
        if not beliefs:
            raise InputError(
                "no detection of this run has a vector of appearance; let the detector send embeddings (DetectionArray)"
            )
        if built is None or built[0] != len(beliefs):
            built = len(beliefs), appearances_of(beliefs, measurements, self._settings)
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
