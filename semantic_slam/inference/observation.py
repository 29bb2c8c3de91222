"""What the engine asks of an observation model: P(z | x, o, c) P(beta | x, o) for one detection (Eq. 4.10)."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.gaussian import GaussianPrior

Array = NDArray[np.float64]
Classes = NDArray[np.int_]


@dataclass(frozen=True)
class Linearisation:
    """log p = log_normaliser - |residual|^2 / 2 at B states, with Jacobians in the tangent spaces there."""

    residual: Array  # (B, m) whitened
    jacobian_robot: Array  # (B, m, d)
    jacobian_object: Array  # (B, m, d)
    log_normaliser: Array  # (B,)


class ObservationModel(Protocol):
    """States are (B, d) robot ``x`` and object ``o`` in map; a detection is opaque to the engine."""

    num_classes: int  # 0: classes are not enumerated

    def geometry(self, detection: Any, x: Array, o: Array) -> Linearisation:
        """The geometric part z_geo."""

    def semantics(self, detection: Any, x: Array, o: Array, classes: Classes) -> Linearisation:
        """The semantic part z_sem for (B,) classes."""

    def geometry_peak(self, detection: Any) -> float:
        """Log of the largest geometric density the detection can reach."""

    def heading_profile(
        self, detection: Any, x: Array, o: Array, classes: Classes, sigma: Array
    ) -> tuple[Array, Array]:
        """(B, K) log of the semantic density when the object is turned by (B, K) angles, far enough for ``sigma`` (B,).

        States without a heading have one angle, 0, and the largest density that the detection can reach.
        """

    def log_visibility(self, x: Array, o: Array, *, soft: bool) -> Array:
        """(B,) log P(beta | x, o), up to a constant that is equal for all beta."""

    def robot_start(self, detection: Any, x: Array, o: Array) -> Array:
        """(B, d) robot states near ``x`` that explain the detection of object ``o``: where a search may start."""

    def object_prior(self, detection: Any, x: Array) -> GaussianPrior:
        """Broad prior of an object first seen from robot state ``x`` (d,)."""

    def factors(self, detection: Any, keys: tuple[int, int], assigned_class: int, x: Array, o: Array) -> list[Any]:
        """GTSAM factors between robot and object keys; (d,) states ``x``, ``o`` are where they are created."""
