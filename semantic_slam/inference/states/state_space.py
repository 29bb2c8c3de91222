"""The state spaces of the engine: planar poses, and planar positions for problems with closed forms."""

from typing import Any, Protocol

import gtsam

from semantic_slam.geometry.arrays import Array


class StateSpace(Protocol):
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
