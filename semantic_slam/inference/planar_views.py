"""Records of views whose semantic measurements enter by factors, independent of each other."""

import numpy as np

from semantic_slam.geometry.small_matrices import cholesky, forward
from semantic_slam.inference.object_views import ObjectViews, class_posterior
from semantic_slam.inference.planar_detection import PlanarDetection
from semantic_slam.inference.planar_observation import viewpoints_in_plane
from semantic_slam.inference.semantics import Moment, Weighed
from semantic_slam.perception.uncertainty import mutual_information
from semantic_slam.viewpoint.model import Array, ViewpointModel, Viewpoints, log_density

NUM_OFFSETS = 50
"""Draws of a measurement from the network's uncertainty about it."""


def score_offsets(detection: PlanarDetection) -> Array:
    """(M, F) draws of the features about their mean, the same wherever the detection is used: a fixed lattice.

    A single one where the network is certain.
    """
    if not detection.feature_covariance.any():
        return np.zeros((1, detection.feature.size))
    normals = np.random.default_rng(NUM_OFFSETS).standard_normal((NUM_OFFSETS, detection.feature.size))
    values, vectors = np.linalg.eigh(detection.feature_covariance)
    return np.asarray(normals @ (vectors * np.sqrt(np.maximum(values, 0.0))).T)


class IndependentViews:
    """Class likelihoods at the modes, to tell the epistemic part and the coverage; no weight of its own."""

    def __init__(self, model: ViewpointModel, correlated_views: float) -> None:
        """``correlated_views``: so many views tell as much as one, as in the factors."""
        self._model, self._power = model, 1.0 / correlated_views

    def weigh(self, moment: Moment) -> Weighed:
        """Records alone: these measurements have factors."""
        return Weighed.silent(
            len(moment.stack.mean), lambda rows: self._records(moment.take(np.array(rows, dtype=int)))
        )

    def _records(self, moment: Moment) -> list[dict[int, ObjectViews]]:
        states = moment.stack.states(moment.mode.y)
        views: list[dict[int, ObjectViews]] = [{} for _ in states]
        for number in range(len(moment.used)):
            self._add(moment, number, states, views)
        return views

    def _add(self, moment: Moment, number: int, states: Array, views: list[dict[int, ObjectViews]]) -> None:
        """The records of one detection's object, which ``views`` may hold from an earlier detection."""
        stack, detection = moment.stack, moment.step.detections[moment.used[number]]
        rows = np.flatnonzero(stack.active[:, number])
        if not len(rows):
            return
        places = stack.rows.objects[rows, number]
        object_ids = [moment.object_ids[place] for place in places]
        parents = [moment.parents[parent] for parent in stack.rows.parents[rows]]
        before = [
            views[row].get(object_id, parent.views.get(object_id))
            for row, object_id, parent in zip(rows, object_ids, parents, strict=True)
        ]
        objects = stack.objects_of(states, number)[rows]
        viewpoints = viewpoints_in_plane(states[rows, 0], objects, detection.sensor)
        likelihoods, exact = self._likelihoods(detection, viewpoints)
        unseen = np.zeros(likelihoods.shape[1])
        known = np.array([record.log_likelihood if record else unseen for record in before])
        prior = moment.log_class_prior[places]
        inside = self._model.in_coverage(np.argmax(prior + known + likelihoods, axis=1), viewpoints)
        inside &= bool(moment.step.in_coverage[moment.used[number]])
        inside &= np.array([record is None or record.in_coverage for record in before])
        drawn = mutual_information(class_posterior((prior + known)[:, None], exact))
        records = zip(known + likelihoods, drawn.tolist(), inside.tolist(), strict=True)
        for row, object_id, record in zip(rows, object_ids, records, strict=True):
            views[row][object_id] = ObjectViews(*record)

    def _likelihoods(self, detection: PlanarDetection, viewpoints: Viewpoints) -> tuple[Array, Array]:
        """(K, C) of the measurement, and up to a constant (K, M, C) of draws of it from the network."""
        count, num_classes = len(viewpoints.azimuth_rad), len(self._model.class_names)
        repeated = Viewpoints(*(np.repeat(value, num_classes) for value in vars(viewpoints).values()))
        prediction = self._model.predict(np.tile(np.arange(num_classes), count), repeated)
        residual = detection.feature - prediction.mean  # (K C, F)
        together = log_density(residual, prediction.covariance + detection.feature_covariance)
        root = cholesky(prediction.covariance)
        moved = forward(root, np.swapaxes(residual[:, None] + score_offsets(detection), 1, 2))  # (K C, F, M)
        scale = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
        exact = (-0.5 * (moved**2).sum(axis=1) - scale[:, None]).reshape(count, num_classes, -1)
        return self._power * together.reshape(count, num_classes), self._power * np.swapaxes(exact, 1, 2)
