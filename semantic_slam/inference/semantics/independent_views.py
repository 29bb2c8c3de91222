"""Records of independent views whose semantic measurements enter the graph as factors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.rows import take
from semantic_slam.geometry.small_matrices import cholesky, forward
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.semantics.interface import ClassModels, SemanticEvidence, SemanticInput
from semantic_slam.inference.states.object_views import ObjectViews, class_posterior, coverage_of
from semantic_slam.perception.uncertainty import mutual_information
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints, log_density
from semantic_slam.viewpoint.outliers import OutlierScores

NUM_OFFSETS = 50
"""Number of samples of a measurement from the network's uncertainty."""


def score_offsets(detection: PlanarDetection) -> Array:
    """(M, F) samples of the features about their mean, from a fixed lattice, so that they are reproducible.

    A single one where the network is certain.
    """
    if not detection.feature_covariance.any():
        return np.zeros((1, detection.feature.size))
    normals = np.random.default_rng(NUM_OFFSETS).standard_normal((NUM_OFFSETS, detection.feature.size))
    values, vectors = np.linalg.eigh(detection.feature_covariance)
    return np.asarray(normals @ (vectors * np.sqrt(np.maximum(values, 0.0))).T)


@dataclass(frozen=True)
class DrawnFeatures:
    """K semantic measurements with M samples of each; F components."""

    sensors: Array  # (K, 2) cameras in the body frame
    features: Array  # (K, F)
    covariances: Array  # (K, F, F) of the dropout samples
    offsets: Array  # (K, M, F)

    @classmethod
    def of(cls, detections: Sequence[PlanarDetection]) -> "DrawnFeatures":
        """Draws of the features of several detections, as many for each."""
        offsets = [score_offsets(detection) for detection in detections]
        most = max(len(own) for own in offsets)
        return cls(
            np.array([detection.sensor for detection in detections]),
            np.array([detection.feature for detection in detections]),
            np.array([detection.feature_covariance for detection in detections]),
            np.array([np.broadcast_to(own, (most, own.shape[1])) for own in offsets]),
        )

    def take(self, rows: Index) -> "DrawnFeatures":
        """The chosen measurements, any number of times."""
        return take(self, rows)


class ClassLikelihoods:
    """Densities of semantic measurements under every class of a viewpoint model."""

    def __init__(self, model: ViewpointModel, tempering: float, outliers: OutlierScores | None = None) -> None:
        """``tempering``: number of views that count as one independent view.

        ``outliers``: score density of outlier views, None to model none. Both as in the view factors.
        """
        self._model, self._power, self._outliers = model, 1.0 / tempering, outliers

    def of(self, drawn: DrawnFeatures, viewpoints: Viewpoints) -> tuple[Array, Array]:
        """(K, C) log densities of K measurements from their viewpoints, and (K, M, C) of their samples.

        The latter are up to a constant.
        """
        count, num_classes = len(viewpoints.azimuth_rad), len(self._model.class_names)
        repeated = Viewpoints(*(np.repeat(value, num_classes) for value in vars(viewpoints).values()))
        prediction = self._model.predict(np.tile(np.arange(num_classes), count), repeated)
        features, covariances, offsets = (
            np.repeat(value, num_classes, axis=0) for value in (drawn.features, drawn.covariances, drawn.offsets)
        )
        residual = features - prediction.mean  # (K C, F)
        together = log_density(residual, prediction.covariance + covariances)
        root = cholesky(prediction.covariance)
        moved = forward(root, np.swapaxes(residual[:, None] + offsets, 1, 2))  # (K C, F, M)
        scale = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
        exact = (-0.5 * (moved**2).sum(axis=1) - scale[:, None]).reshape(count, num_classes, -1)
        together, exact = together.reshape(count, num_classes), np.swapaxes(exact, 1, 2)
        if self._outliers is not None:
            return self._mixed(self._outliers, drawn, together, exact)
        return self._power * together, self._power * exact

    def _mixed(
        self, outliers: OutlierScores, drawn: DrawnFeatures, together: Array, exact: Array
    ) -> tuple[Array, Array]:
        """Outlier mixtures of (K, C) and (K, M, C) densities; all samples of one view are outliers, or none."""
        count, draws, size = drawn.offsets.shape
        log_outlier = outliers.log_density(drawn.features, drawn.covariances)[:, None]
        moved = (drawn.features[:, None] + drawn.offsets).reshape(-1, size)
        log_moved = outliers.log_density(moved, np.zeros((len(moved), size, size))).reshape(count, draws, 1)
        exact = exact - 0.5 * size * np.log(2.0 * np.pi)
        return (
            outliers.mixed(self._power * together, self._power * log_outlier)[0],
            outliers.mixed(self._power * exact, self._power * log_moved)[0],
        )


class IndependentViews:
    """Class likelihoods at the modes, for the epistemic part and the coverage; they add no weight."""

    def __init__(self, model: ViewpointModel, tempering: float, outliers: OutlierScores | None = None) -> None:
        """``tempering``: number of views that count as one independent view.

        ``outliers``: score density of outlier views, None to model none. Both as in the view factors.
        """
        self._model, self._likelihoods = model, ClassLikelihoods(model, tempering, outliers)

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the configured viewpoint model, which the kind of class models must have."""
        assert models.viewpoint is not None
        return cls(models.viewpoint, models.tempering, models.outliers)

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Records only: these measurements have factors."""
        return SemanticEvidence.silent(
            len(given.stack.mean), lambda rows: self._records(given.take(np.array(rows, dtype=int)))
        )

    def _records(self, given: SemanticInput) -> list[dict[int, ObjectViews]]:
        states, stack = given.stack.states(given.mode.y), given.stack
        views: list[dict[int, ObjectViews]] = [{} for _ in states]
        rows, numbers = np.nonzero(stack.active)
        same = stack.rows.objects[rows] == stack.rows.objects[rows, numbers][:, None]
        earlier = (same & (np.arange(stack.active.shape[1]) < numbers[:, None])).sum(axis=1)
        for times in range(earlier.max(initial=-1) + 1):  # an object may be seen twice
            now = earlier == times
            self._add(given, rows[now], numbers[now], states, views)
        return views

    def _add(
        self, given: SemanticInput, rows: Index, numbers: Index, states: Array, views: list[dict[int, ObjectViews]]
    ) -> None:
        """Add the records of the objects of some detections (K,), continuing those already in ``views``."""
        stack, used = given.stack, given.used[numbers]
        places = stack.rows.objects[rows, numbers]
        object_ids = [given.object_ids[place] for place in places]
        parents = [given.parents[parent] for parent in stack.rows.parents[rows]]
        before = [
            views[row].get(object_id, parent.views.get(object_id))
            for row, object_id, parent in zip(rows.tolist(), object_ids, parents, strict=True)
        ]
        objects = states[rows, 1 + stack.slots[rows, numbers], : stack.spaces.storage.landmark]
        drawn = DrawnFeatures.of([given.step.detections[i] for i in given.used])
        viewpoints = stack.spaces.viewpoints(stack.robots_of(states)[rows], objects, drawn.sensors[numbers])
        likelihoods, exact = self._likelihoods.of(drawn.take(numbers), viewpoints)
        unseen = np.zeros(likelihoods.shape[1])
        known = np.array([record.log_likelihood if record else unseen for record in before])
        prior = given.log_class_prior[places]
        inside = self._model.in_coverage(np.argmax(prior + known + likelihoods, axis=1), viewpoints)
        coverages = [
            coverage_of(record).with_view(float(azimuth), is_recognised=bool(known_picture), is_fitted=bool(fitted))
            for record, azimuth, known_picture, fitted in zip(
                before, viewpoints.azimuth_rad, given.step.in_coverage[used], inside, strict=True
            )
        ]
        doubt = mutual_information(class_posterior((prior + known)[:, None], exact))
        told = known + np.where(_are_outliers(given, rows, numbers)[:, None], 0.0, likelihoods)
        records = zip(rows.tolist(), object_ids, told, doubt.tolist(), coverages, strict=True)
        for row, object_id, log_likelihood, information, coverage in records:
            views[row][object_id] = ObjectViews(
                log_likelihood=log_likelihood, mutual_information=information, coverage=coverage
            )


def _are_outliers(given: SemanticInput, rows: Index, numbers: Index) -> Flags:
    """(K,) which views are outliers in these candidates, and leave their object's class open."""
    classes = given.stack.rows.classes
    return np.zeros(len(rows), dtype=bool) if classes is None else np.asarray(classes[rows, numbers] < 0)
