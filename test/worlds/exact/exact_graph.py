"""The factors of a smoother that holds its measurements linear, as GTSAM would evaluate them: an independent graph."""

from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.odometry_bias import biased_factor
from semantic_slam.inference.models.planar.detection import PlanarDetections
from semantic_slam.inference.smoothing.linear.measured import Motions, Sightings
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.keys import is_vector


def exact_graph(smoother: Smoother) -> gtsam.NonlinearFactorGraph:
    """Its measurements as they are, wherever they were made linear, and its other factors."""
    linear, held = smoother.in_charts, smoother.isam.getFactorsUnsafe()
    assert linear is not None
    measured = set[int]()
    graph = gtsam.NonlinearFactorGraph()
    for own in linear.joined:
        measured |= set(own.slots.tolist())
        for row, terms in enumerate(own.of.terms()):
            graph.add(_motion(own.of, row, terms) if isinstance(own.of, Motions) else _sighting(own.of, row, terms))
    for slot in range(held.size()):
        if held.exists(slot) and slot not in measured:
            graph.add(held.at(slot))
    return graph


def estimate_of(smoother: Smoother) -> gtsam.Values:
    """Estimates of all of its variables."""
    values = smoother.isam.calculateEstimate()
    for key in [key for key in values.keys() if not is_vector(key)]:  # noqa: SIM118
        values.update(key, gtsam.Pose2(*smoother.states([key])[0]))
    return values


Terms = tuple[int, int, list[Any]]


def _motion(own: Motions, row: int, terms: Terms) -> Any:
    first, second, biases = terms
    root = own.roots[row]
    covariance = np.linalg.inv(root.T @ root)
    if biases:
        change = -np.linalg.inv(root) @ own.by_bias[row]
        return biased_factor((first, second, biases[0]), own.controls[row], covariance, change)
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    return gtsam.BetweenFactorPose2(first, second, gtsam.Pose2(*own.controls[row]), noise)


def _sighting(own: Sightings, row: int, terms: Terms) -> Any:
    robot, landmark, (key, slopes) = terms
    seen: PlanarDetections = own.seen
    covariance = np.linalg.inv(seen.whiten[row].T @ seen.whiten[row])[::-1, ::-1]
    bearing, noise = gtsam.Rot2.fromAngle(seen.bearing_rad[row]), gtsam.noiseModel.Gaussian.Covariance(covariance)
    plain = gtsam.BearingRangeFactorPose2(robot, landmark, bearing, seen.range_m[row], noise)
    turned = np.asfortranarray(slopes[::-1])  # GTSAM's order: bearing, range

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        if jacobians is not None:
            jacobian = own.scale[row] * plain.linearize(values).jacobian()[0]
            jacobians[0], jacobians[1], jacobians[2] = jacobian[:, :3], jacobian[:, 3:], turned
        return np.asarray(own.scale[row] * plain.whitenedError(values) + turned @ values.atVector(key))

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(2), [robot, landmark, key], error)
