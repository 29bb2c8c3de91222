"""What the engine asks of an observation model: P(z | x, o, c) P(beta | x, o) for one detection (Eq. 4.10)."""

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
        """(B, m) which components there are: a bearing alone has no range."""
        return np.asarray(self.jacobian_object.any(axis=-1))


@dataclass(frozen=True)
class Innovation:
    """Detections (B,) before they are taken in, linearised, against Gaussians of robot and object."""

    root: Array  # (B, m, m) Cholesky factor of the whitened residual's covariance
    whitened: Array  # (B, m) that residual in its own standard deviations
    log_density: Array  # (B,)

    @classmethod
    def of(cls, part: Linearisation, jacobian: Array, covariance: Array, added: Array | None = None) -> "Innovation":
        """``jacobian`` (B, m, n) of the residual by what has the ``covariance`` (B, n, n).

        ``added`` (B, m): variance of its components beyond one; None: none.
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
    """Detections as arrays, a row each."""

    def take(self, index: Selection) -> "Detections":
        """Rows of a selection."""


@runtime_checkable
class ModelsOutliers(Protocol):
    """An observation model whose classes are -1 where a view's score tells nothing of the object's class."""

    def log_outlier(self, seen: Any) -> Array | None:
        """(S,) log of the share of outliers times the density of the score as one; None: no view is an outlier."""


@runtime_checkable
class TurnsByTwo(Protocol):
    """An observation model in which two detections tell how the robot is turned about the vertical of map."""

    def turned_start(self, detections: Any, x: Array, first: Array, second: Array) -> Array:
        """(B, s) robots ``x``, turned and moved so that the two detections are of objects ``first`` and ``second``."""


class ObservationModel(Protocol):
    """States are (B, s) robot ``x`` and object ``o`` in map, each of its space; a detection is opaque to the engine.

    Of S ``detections`` the rows repeat: state b is of detection b mod S.
    """

    @property
    def num_classes(self) -> int:
        """Classes that hypotheses enumerate; 0: none."""

    @property
    def new_objects(self) -> NewObjectConfiguration:
        """What is known of an object before its first detection."""

    def collect(self, detections: Sequence[Any]) -> Detections:
        """Detections as arrays, a row each."""

    def geometry(self, detections: Any, x: Array, o: Array) -> Linearisation:
        """The geometric part z_geo of the collected detections."""

    def semantics(self, detections: Any, x: Array, o: Array, classes: Classes) -> Linearisation:
        """The semantic part z_sem for (B,) classes."""

    def log_likelihood(self, detections: Any, x: Array, o: Array, classes: Classes | None) -> Array:
        """(B,) log density of both, without slopes; of the geometric part alone where ``classes`` is None."""

    def best_heading(self, detections: Any, x: Array, o: Array, classes: Classes, sigma: Array) -> tuple[Array, Array]:
        """(B,) largest semantic log density of one detection over turned objects, and (B,) the turn [rad] to it.

        The turn is the best where headings deviate by ``sigma`` (B,) a priori. States without a heading have none.
        """

    def log_visibility(self, x: Array, o: Array, *, soft: bool) -> Array:
        """(B,) log P(beta | x, o), up to a constant that is equal for all beta."""

    def robot_start(self, detections: Any, x: Array, o: Array) -> Array:
        """(B, s) robot states near ``x`` that explain the detections of objects ``o``: where a search may start."""

    def object_prior(self, detection: Any, x: Array) -> GaussianPrior:
        """Broad prior of an object first seen from robot state ``x`` (s,)."""

    def geometry_factor(self, detection: Any, keys: tuple[int, int]) -> Any:
        """GTSAM factor between robot and object."""

    def bearing_sigma(self, x: Array, o: Array, covariance: Array, charts: Array) -> Array:
        """(B,) radians by which an object's place as the robot sees it is uncertain, seen from the robot.

        ``covariance`` (B, r + l, r + l) is of robot and object in tangent spaces from which ``charts`` like it lead
        to those at their states.
        """

    def view_change(self, before: Array, now: Array) -> Array:
        """(n,) radians by which views of objects differ, given (n, s) objects as the robot sees them."""

    def least_cost(self, detections: Any, x: Array, covariance: Array, o: Array, sigmas: Array) -> tuple[Array, float]:
        """(P, D, O) nats that D detections cost at least if they are of each of O objects, and the log of all their
        densities' peaks.

        Robots (P, s) have (P, r, r) ``covariance``; the positions of objects (P, O, s) have no larger standard
        deviation than ``sigmas`` (O,) [m] in any direction.
        """
