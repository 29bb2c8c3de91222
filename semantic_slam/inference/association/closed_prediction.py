"""Prediction of a keyframe in a closed world: motion, and then the measurement of gravity, before detections.

The measurement changes a hypothesis's weight, too: by its density under the predicted robot.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from semantic_slam.geometry.arrays import Array, column_products
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.spatial.gravity import Gravity
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces


def predict(
    components: Sequence[Component], motion: Motion, known: Sequence[int], new: Sequence[dict[int, GaussianPrior]]
) -> PredictedBelief:
    """Predict b^-[x_k, O] (Eqs. 4.11, 4.21) for every parent; new objects come after the known ones.

    Where gravity is measured, it is that belief given the measurement.
    """
    spaces = components[0].spaces
    mean, covariance = _moved(components, motion, known)
    if motion.gravity is not None:
        mean, covariance = _levelled(spaces, motion.gravity, mean, covariance)
    if not any(new):
        return PredictedBelief(spaces.layout, mean, covariance)
    added = [list(priors.values()) for priors in new]
    mean = spaces.storage.stacked(mean, np.array([[prior.mean for prior in priors] for priors in added]))
    pairs = zip(covariance, added, strict=True)
    spread = np.array([block_diag(own, *(p.covariance for p in priors)) for own, priors in pairs])
    return PredictedBelief(spaces.layout, mean, spread)


def log_levels(components: Sequence[Component], motion: Motion) -> Array:
    """(P,) log densities of the measurement of gravity under the predictions of the parents; 0 without one."""
    if motion.gravity is None:
        return np.zeros(len(components))
    robots, covariances = _moved(components, motion, [])
    pairs = zip(robots[:, 0, : components[0].spaces.storage.robot], covariances, strict=True)
    return np.array([motion.gravity.at_mode(*robot).log_evidence for robot in pairs])


def _moved(components: Sequence[Component], motion: Motion, known: Sequence[int]) -> tuple[Array, Array]:
    """(P, 1 + O, s) means and (P, r + O l, r + O l) covariances of robot and ``known`` objects after the motion."""
    spaces = components[0].spaces
    keys = [robot_key(components[0].keyframe), *(object_key(n) for n in known)]
    mean = np.array([component.states(keys) for component in components])
    covariance = np.array([component.joint_covariance(keys) for component in components])
    own, robot, transition = spaces.storage.block(0), spaces.layout.block(0), spaces.robot.propagation(motion.control)
    mean[:, 0, own] = spaces.robot.compose(mean[:, 0, own], motion.control)
    cross = column_products(transition, covariance[:, robot])
    covariance[:, robot], covariance[:, :, robot] = cross, np.swapaxes(cross, 1, 2)
    covariance[:, robot, robot] = cross[..., robot] @ transition.T + motion.covariance
    return mean, covariance


def _levelled(spaces: Spaces, gravity: Gravity, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Means (P, 1 + O, s) given the measurement, and covariances in the tangent spaces there."""
    own, joint, layout = spaces.storage.block(0), spaces.joint, spaces.layout
    levels = [gravity.at_mode(*robot) for robot in zip(mean[:, 0, own], covariance, strict=True)]
    moves, charts = joint.exp_and_jacobian(layout.blocks(np.array([level.shift for level in levels])))
    slopes = np.array([block_diag(*_charts(spaces, chart)) for chart in charts])
    spread = np.array([level.covariance for level in levels])
    return joint.compose(mean, moves), slopes @ spread @ np.swapaxes(slopes, 1, 2)


def _charts(spaces: Spaces, chart: Array) -> list[Array]:
    """Jacobians of the retraction of a robot and its objects, each of its own size, from (1 + O, w, w)."""
    r, landmark = spaces.layout.robot, spaces.layout.landmark
    return [chart[0, :r, :r], *chart[1:, :landmark, :landmark]]
