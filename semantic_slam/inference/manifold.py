"""The state spaces of the engine: planar poses, and planar positions for problems with closed forms."""

from typing import Any, Protocol

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se2

Array = NDArray[np.float64]


class Manifold(Protocol):
    """States are (..., d) arrays, tangent vectors (..., d); perturbations act on the right."""

    dimension: int
    relinearize_threshold: Array  # (d,) change of a state from which on factors are linearised anew
    far: Array  # (d,) the same where updates are not iterated: what moves without turning stays where it is linear

    def __hash__(self) -> int:
        """What is made once for a manifold is kept."""

    def compose(self, state: Array, control: Array) -> Array:
        """The state after a control."""

    def frame(self, state: Array) -> Array:
        """(..., f) a state to compose with many a control: its d coordinates first."""

    def placed(self, frame: Array, control: Array) -> Array:
        """:meth:`compose` from a :meth:`frame`, headings as they add up."""

    def along(self, start: Array, controls: Array) -> Array:
        """(..., T, d) states from ``start`` (..., d) after each of (..., T, d) controls, headings as they add up."""

    def wrapped(self, state: Array) -> Array:
        """The same states, headings in [-pi, pi)."""

    def retract(self, state: Array, tangent: Array) -> Array:
        """state * Exp(tangent)."""

    def local(self, state: Array, other: Array) -> Array:
        """Log(state^-1 other)."""

    def between(self, state: Array, other: Array) -> Array:
        """``other`` as seen from ``state``."""

    def mean(self, states: Array, weights: Array) -> Array:
        """(..., d) mean of (P, ..., d) states with (P,) normalised weights, in map: of positions and of directions."""

    def exp(self, tangent: Array) -> Array:
        """State at the origin moved by (..., d) tangent vectors: retract(state, t) is compose(state, exp(t))."""

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        """The same, and (..., d, d): change of retract(state, t) in its own tangent space per change of t."""

    def propagation(self, control: Array) -> Array:
        """(..., d, d) F with (x Exp(e)) u = (x u) Exp(F e)."""

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        """Insert one state (d,) into GTSAM values."""

    def state(self, values: gtsam.Values, key: int) -> Array:
        """(d,) state of ``key``."""

    def states(self, values: gtsam.Values) -> Array:
        """(n, d) of all keys, in ascending order."""

    def prior_factor(self, key: int, mean: Array, covariance: Array) -> Any:
        """Gaussian prior; covariance in the tangent space at the mean."""

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        """Motion model P(x_k | x_{k-1}, u)."""


class PlanarPoses:
    """SE(2): x, y [m], yaw [rad]."""

    dimension = 3
    relinearize_threshold = np.array([0.1, 0.1, 0.05])
    far = np.array([5.0, 5.0, 0.1])

    def compose(self, state: Array, control: Array) -> Array:
        return se2.compose(state, control)

    def frame(self, state: Array) -> Array:
        return se2.frame(state)

    def placed(self, frame: Array, control: Array) -> Array:
        return se2.placed(frame, control)

    def along(self, start: Array, controls: Array) -> Array:
        return se2.along(start, controls)

    def wrapped(self, state: Array) -> Array:
        return se2.wrapped(state)

    def retract(self, state: Array, tangent: Array) -> Array:
        return se2.retract(state, tangent)

    def local(self, state: Array, other: Array) -> Array:
        return se2.log(se2.between(state, other))

    def between(self, state: Array, other: Array) -> Array:
        return se2.between(state, other)

    def mean(self, states: Array, weights: Array) -> Array:
        heading = np.arctan2(weights @ np.sin(states[..., 2]), weights @ np.cos(states[..., 2]))
        return np.concatenate([np.tensordot(weights, states[..., :2], 1), heading[..., None]], axis=-1)

    def exp(self, tangent: Array) -> Array:
        return se2.exp(tangent)

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        return se2.exp_and_jacobian(tangent)

    def propagation(self, control: Array) -> Array:
        return se2.inverse_adjoint(control)

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        values.insert(key, gtsam.Pose2(*state.tolist()))

    def state(self, values: gtsam.Values, key: int) -> Array:
        pose = values.atPose2(key)
        return np.array([pose.x(), pose.y(), pose.theta()])

    def states(self, values: gtsam.Values) -> Array:
        return np.asarray(gtsam.utilities.extractPose2(values))

    def prior_factor(self, key: int, mean: Array, covariance: Array) -> Any:
        return gtsam.PriorFactorPose2(key, gtsam.Pose2(*mean), gtsam.noiseModel.Gaussian.Covariance(covariance))

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        return gtsam.BetweenFactorPose2(key, next_key, gtsam.Pose2(*control), noise)


class PlanarPositions:
    """R^2: x, y [m]. With linear models every belief of the engine is exact here."""

    dimension = 2
    relinearize_threshold = np.array([0.1, 0.1])
    far = np.array([5.0, 5.0])

    def compose(self, state: Array, control: Array) -> Array:
        return np.asarray(state + control)

    def frame(self, state: Array) -> Array:
        return state

    def placed(self, frame: Array, control: Array) -> Array:
        return np.asarray(frame + control)

    def along(self, start: Array, controls: Array) -> Array:
        return np.asarray(start[..., None, :] + np.cumsum(controls, axis=-2))

    def wrapped(self, state: Array) -> Array:
        return state

    def retract(self, state: Array, tangent: Array) -> Array:
        return np.asarray(state + tangent)

    def local(self, state: Array, other: Array) -> Array:
        return np.asarray(other - state)

    def between(self, state: Array, other: Array) -> Array:
        return np.asarray(other - state)

    def mean(self, states: Array, weights: Array) -> Array:
        return np.asarray(np.tensordot(weights, states, 1))

    def exp(self, tangent: Array) -> Array:
        return tangent

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        return tangent, np.broadcast_to(np.eye(2), (*tangent.shape[:-1], 2, 2))

    def propagation(self, control: Array) -> Array:
        return np.broadcast_to(np.eye(2), (*control.shape[:-1], 2, 2))

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        values.insert(key, np.asarray(state))

    def state(self, values: gtsam.Values, key: int) -> Array:
        return np.asarray(values.atPoint2(key))

    def states(self, values: gtsam.Values) -> Array:
        return np.asarray(gtsam.utilities.extractPoint2(values))

    def prior_factor(self, key: int, mean: Array, covariance: Array) -> Any:
        return gtsam.PriorFactorPoint2(key, np.asarray(mean), gtsam.noiseModel.Gaussian.Covariance(covariance))

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        return gtsam.BetweenFactorPoint2(key, next_key, np.asarray(control), noise)
