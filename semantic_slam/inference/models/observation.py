"""The interface of an observation model: P(z | x, o, c) P(beta | x, o) for one detection (Eq. 4.10)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import NewObjectConfiguration
from semantic_slam.geometry.arrays import Array, Flags, row_sums, squared_norms
from semantic_slam.geometry.rows import Selection
from semantic_slam.geometry.small_matrices import cholesky, forward
from semantic_slam.inference.states.gaussian import GaussianPrior

Classes = NDArray[np.int_]


@dataclass(frozen=True, kw_only=True)
class Linearisation:
    """log p = log_normaliser - |residual|^2 / 2 at B states, with Jacobians in the tangent spaces there."""

    residual: Array  # (B, m) whitened
    jacobian_robot: Array  # (B, m, r)
    jacobian_object: Array  # (B, m, l)
    log_normaliser: Array  # (B,)

    @property
    def measured(self) -> Flags:
        """(B, m) which components are measured: a bearing alone has no range."""
        return np.asarray(self.jacobian_object.any(axis=-1))


@dataclass(frozen=True)
class Innovation:
    """Innovations of detections (B,), linearised, against Gaussians of robot and object."""

    root: Array  # (B, m, m) Cholesky factor of the whitened residual's covariance
    whitened: Array  # (B, m) the residual in units of that covariance
    log_density: Array  # (B,)

    @classmethod
    def of(cls, part: Linearisation, jacobian: Array, covariance: Array, added: Array | None = None) -> "Innovation":
        """The innovation by the residual's ``jacobian`` (B, m, n) and the ``covariance`` (B, n, n) of its variables.

        ``added`` (B, m): variance of the whitened components beyond one; None: none.
        """
        spread = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2) + np.eye(jacobian.shape[1])
        if added is not None:
            spread += added[:, :, None] * np.eye(jacobian.shape[1])
        root = cholesky(spread)
        whitened = forward(root, part.residual[..., None])[..., 0]
        log_determinant = row_sums(np.log(np.einsum("bii->bi", root)))
        return cls(root, whitened, part.log_normaliser - 0.5 * squared_norms(whitened) - log_determinant)

    @property
    def distance(self) -> Array:
        """(B,) Mahalanobis distances of the innovation."""
        return np.asarray(np.linalg.norm(self.whitened, axis=-1))


class Detections(Protocol):
    """Detections as arrays, one row each."""

    def take(self, index: Selection) -> "Detections":
        """The rows of a selection."""


@runtime_checkable
class ModelsOutliers(Protocol):
    """An observation model with outlier views: their class is -1 and their score says nothing of the object's class."""

    def log_outlier(self, seen: Any) -> Array | None:
        """(S,) log of the outlier share times the score's density as an outlier; None: no view is an outlier."""


@runtime_checkable
class TurnsByTwo(Protocol):
    """An observation model in which two detections determine the robot's yaw about the vertical of map."""

    def turned_start(self, detections: Any, x: Array, first: Array, second: Array) -> Array:
        """(B, s) robots ``x``, rotated and moved so that the two detections fit objects ``first`` and ``second``."""


class ObservationModel(Protocol):
    """An observation model; states are (B, s) robot ``x`` and object ``o`` in map, detections are opaque to the engine.

    Rows of S ``detections`` repeat: state b belongs to detection b mod S.
    """

    @property
    def num_classes(self) -> int:
        """Number of classes that hypotheses enumerate; 0: none."""

    @property
    def new_objects(self) -> NewObjectConfiguration:
        """Prior knowledge of an object before its first detection."""

    def collect(self, detections: Sequence[Any]) -> Detections:
        """Detections as arrays, one row each."""

    def geometry(self, detections: Any, x: Array, o: Array) -> Linearisation:
        """The geometric part z_geo of the collected detections, linearised."""

    def semantics(self, detections: Any, x: Array, o: Array, classes: Classes) -> Linearisation:
        """The semantic part z_sem under (B,) classes, linearised."""

    def log_likelihood(self, detections: Any, x: Array, o: Array, classes: Classes | None) -> Array:
        """(B,) log density of both parts, without Jacobians; of the geometric part alone where ``classes`` is None."""

    def best_heading(self, detections: Any, x: Array, o: Array, classes: Classes, sigma: Array) -> tuple[Array, Array]:
        """(B,) maximum over object headings of one detection's semantic log density, and (B,) the turn [rad] to it.

        The turn is the maximum a posteriori one, with headings deviating by ``sigma`` (B,) a priori. States without a
        heading have no turn.
        """

    @property
    def sees_everywhere(self) -> bool:
        """Whether P(beta | x, o) is constant, as there are no limits of visibility."""

    def log_visibility(self, x: Array, o: Array, *, soft: bool) -> Array:
        """(B,) log P(beta | x, o), up to a constant that is equal for all beta."""

    def robot_start(self, detections: Any, x: Array, o: Array) -> Array:
        """(B, s) robot states near ``x`` that explain the detections of objects ``o``: start of a mode search."""

    def object_prior(self, detection: Any, x: Array) -> GaussianPrior:
        """Broad prior of an object first detected from robot state ``x`` (s,)."""

    def geometry_factor(self, detection: Any, keys: tuple[int, int]) -> Any:
        """GTSAM factor of the geometric part between the robot and object ``keys``."""

    def bearing_sigma(self, x: Array, o: Array, covariance: Array, charts: Array) -> Array:
        """(B,) uncertainty [rad] of the direction in which the robot sees an object.

        ``covariance`` (B, r + l, r + l) is of robot and object in other tangent spaces; ``charts``, of the same shape,
        are the Jacobians from those to the tangent spaces at their states.
        """

    def view_change(self, before: Array, now: Array) -> Array:
        """(n,) angle [rad] between views of objects, given (n, s) objects in the robot's frame."""

    def least_cost(self, detections: Any, x: Array, covariance: Array, o: Array, sigmas: Array) -> tuple[Array, float]:
        """(P, D, O) lower bound [nats] on the cost of D detections under O objects, and the log of all density peaks.

        Robots (P, s) have (P, r, r) ``covariance``; no position of an object (P, O, s) has a standard deviation above
        ``sigmas`` (O,) [m] in any direction.
        """
