"""Records of views whose semantic measurements enter by factors, independent of each other."""

import numpy as np

from semantic_slam.inference.object_views import ObjectViews, class_posterior
from semantic_slam.inference.planar_detection import PlanarDetection
from semantic_slam.inference.planar_observation import viewpoints_in_plane
from semantic_slam.inference.semantics import Moment, Weighed
from semantic_slam.perception.uncertainty import mutual_information
from semantic_slam.viewpoint.model import Array, ViewpointModel, Viewpoints, log_density

NUM_OFFSETS = 50
"""Draws of a measurement from the network's uncertainty about it."""


def score_offsets(detection: PlanarDetection) -> Array:
    """(M, F) draws of the features about their mean, the same wherever the detection is used: a fixed lattice."""
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
        stack = moment.stack
        states = stack.states(moment.mode.y)
        count = len(states)
        views: list[dict[int, ObjectViews]] = [{} for _ in range(count)]
        for number, index in enumerate(moment.used):
            detection = moment.step.detections[index]
            viewpoints = viewpoints_in_plane(states[:, 0], stack.objects_of(states, number), detection.sensor)
            flag = bool(moment.step.in_coverage[index])
            likelihoods, exact = self._likelihoods(detection, viewpoints)
            for row in np.flatnonzero(stack.active[:, number]):
                place = stack.rows.objects[row, number]
                object_id = moment.object_ids[place]
                parent = moment.parents[stack.rows.parents[row]]
                before = views[row].get(object_id, parent.views.get(object_id))
                known = before.log_likelihood if before else np.zeros(likelihoods.shape[1])
                after = known + likelihoods[row]
                best = int(np.argmax(moment.log_class_prior[place] + after))
                view = Viewpoints(*(value[row : row + 1] for value in vars(viewpoints).values()))
                inside = flag and bool(self._model.in_coverage(np.array([best]), view)[0])
                drawn = class_posterior(moment.log_class_prior[place] + known, exact[row])
                views[row][object_id] = ObjectViews(
                    after, float(mutual_information(drawn)), inside and (before is None or before.in_coverage)
                )
        return Weighed(np.zeros(count), np.full(count, np.nan), views, [None] * count)

    def _likelihoods(self, detection: PlanarDetection, viewpoints: Viewpoints) -> tuple[Array, Array]:
        """(K, C) of the measurement, and up to a constant (K, M, C) of draws of it from the network."""
        count, num_classes = len(viewpoints.azimuth_rad), len(self._model.class_names)
        repeated = Viewpoints(*(np.repeat(value, num_classes) for value in vars(viewpoints).values()))
        prediction = self._model.predict(np.tile(np.arange(num_classes), count), repeated)
        residual = detection.feature - prediction.mean
        together = log_density(residual, prediction.covariance + detection.feature_covariance)
        root = np.linalg.cholesky(prediction.covariance)
        moved = np.linalg.solve(root, np.swapaxes(residual[:, None] + score_offsets(detection), 1, 2))  # (K C, F, M)
        scale = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
        exact = (-0.5 * (moved**2).sum(axis=1) - scale[:, None]).reshape(count, num_classes, -1)
        return self._power * together.reshape(count, num_classes), self._power * np.swapaxes(exact, 1, 2)
