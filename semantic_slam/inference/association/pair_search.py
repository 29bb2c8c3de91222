"""Pairs of a detection and an object, linearised at their joint mode instead of the prediction.

Where robot or object are uncertain, one linearisation at the prediction holds only near it: the direction to an object
is no linear function of where the robot stands. A detection is therefore linearised at the mode of robot and object
given both, pair by pair. Joint weighing of several detections starts from there.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, squared_norms
from semantic_slam.geometry.levenberg_marquardt import LevenbergMarquardt
from semantic_slam.geometry.rows import take
from semantic_slam.inference.models.observation import Linearisation, ObservationModel
from semantic_slam.inference.states.spaces import Spaces

LARGEST_BEND = 0.3
"""Second-order term of a measurement, in sigmas, from which on one linearisation at the prediction does not hold."""
MOST_STEPS, TOLERANCE = 6, 1e-2
"""Most steps of a search, and expected gain [nats] below which it stops."""
CLOSE = 0.1
"""Nats that a further step may be expected to gain where a search has reached a mode."""
FIRST_STEPS, HOPELESS = 2, 50.0
"""Number of steps after which a pair whose energy is still above so many nats is dropped: no gate admits it."""


class PairSearch(ABC):
    """The energies of B pairs of a robot and an object, whitened by their joint prediction."""

    detections: Any  # B
    root: Array  # (B, n, n) Cholesky factor of the predicted covariance of robot and object, and what else there is

    @abstractmethod
    def part(self, tangent: Array) -> Linearisation:
        """The detections at states ``tangent`` (B, n) away, with Jacobians by tangent vectors at the prediction."""

    @abstractmethod
    def select(self, selection: Index) -> Self:
        """The chosen pairs."""

    def begun(self) -> LevenbergMarquardt:
        """The searches where they begin: at the prediction."""
        return LevenbergMarquardt(self, np.zeros((len(self.root), self.root.shape[-1])))

    def jacobian(self, part: Linearisation) -> Array:
        """(B, m, n) Jacobian of the residuals."""
        return np.concatenate([part.jacobian_robot, part.jacobian_object], axis=-1)

    def mode(self, most_steps: int = MOST_STEPS) -> Array:
        """(B, n) mode of each pair; where dropped, the point at which the search stopped."""
        search = self.begun()
        search.advance(FIRST_STEPS, np.full(len(self.root), TOLERANCE))
        y = search.y
        left = np.flatnonzero(search.energy + self.detections.log_normaliser < HOPELESS)
        y[left] = search.select(left).finished(most_steps - FIRST_STEPS, TOLERANCE).y
        return y

    def is_mode(self, y: Array) -> Flags:
        """(B,) whether ``y`` is a mode: an undamped step from there is expected to gain less than ``CLOSE``."""
        _, gradient, hessian = self.normal_equations(y)
        return np.asarray(0.5 * np.vecdot(gradient, np.linalg.solve(hessian, gradient[..., None])[..., 0]) < CLOSE)

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, n) and Gauss-Newton Hessian (B, n, n)."""
        part = self.part(self.tangent(y))
        jacobian = self.jacobian(part) @ self.root
        energy = 0.5 * (squared_norms(part.residual) + squared_norms(y)) - part.log_normaliser
        gradient = y + (np.swapaxes(jacobian, 1, 2) @ part.residual[..., None])[..., 0]
        return energy, gradient, np.eye(y.shape[1]) + np.swapaxes(jacobian, 1, 2) @ jacobian

    def linearised(self, y: Array) -> Linearisation:
        """The detections as linear functions about the prediction, linearised at ``y`` (B, n)."""
        tangent = self.tangent(y)
        part = self.part(tangent)
        return replace(part, residual=part.residual - (self.jacobian(part) @ tangent[..., None])[..., 0])

    def tangent(self, y: Array) -> Array:
        """(B, n) tangent vectors at the prediction, of whitened ``y`` (B, n)."""
        return np.asarray((self.root @ y[..., None])[..., 0])


@dataclass(frozen=True, kw_only=True)
class StatePairs(PairSearch):
    """Pairs in the tangent spaces of robot and object."""

    spaces: Spaces
    model: ObservationModel
    detections: Any  # B
    robots: Array  # (B, s)
    objects: Array  # (B, s)
    root: Array  # (B, r + l, r + l)

    def part(self, tangent: Array) -> Linearisation:
        r = self.spaces.layout.robot
        robot, by_robot = self.spaces.robot.exp_and_jacobian(tangent[:, :r])
        landmark, by_object = self.spaces.landmark.exp_and_jacobian(tangent[:, r:])
        x, o = self.spaces.robot.compose(self.robots, robot), self.spaces.landmark.compose(self.objects, landmark)
        plain = self.model.geometry(self.detections, x, o)
        return replace(
            plain,
            jacobian_robot=plain.jacobian_robot @ by_robot,
            jacobian_object=plain.jacobian_object @ by_object,
        )

    def select(self, selection: Index) -> "StatePairs":
        return take(self, selection, ("detections", "robots", "objects", "root"))


def bend(turns: Array, jacobian: Array, covariance: Array) -> Array:
    """(B,) second-order term of a measurement at one standard deviation of the prediction, in sigmas.

    ``turns`` (B,): standard deviations of bearings [rad]; ``jacobian`` (B, m, n) of whitened residuals; ``covariance``
    (B, n, n). A direction that turns by a = sigma c has a second-order term of a^2 / 2 of its distance.
    """
    return np.asarray(0.5 * turns * np.einsum("bij,bjk,bik->b", jacobian, covariance, jacobian))
