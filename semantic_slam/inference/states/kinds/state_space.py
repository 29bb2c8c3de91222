"""Interface of a state space (manifold): retraction, Jacobians, GTSAM conversion; one file and contract test each."""

from typing import Any, ClassVar, Protocol

import gtsam

from semantic_slam.geometry.arrays import Array


class StateArithmetic(Protocol):
    """Calculus over arrays of states (..., s) and tangent vectors (..., d); perturbations act on the right."""

    def compose(self, state: Array, control: Array) -> Array:
        """The state after a control."""

    def frame(self, state: Array) -> Array:
        """(..., f) a precomputed form of a state for composing it with many controls: its s coordinates first."""

    def placed(self, frame: Array, control: Array) -> Array:
        """:meth:`compose` from a :meth:`frame`, without wrapping headings."""

    def retract(self, state: Array, tangent: Array) -> Array:
        """state * Exp(tangent)."""

    def local(self, state: Array, other: Array) -> Array:
        """Log(state^-1 other)."""

    def exp(self, tangent: Array) -> Array:
        """State at the origin moved by (..., d) tangent vectors: retract(state, t) is compose(state, exp(t))."""

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        """:meth:`exp`, and its right Jacobian (..., d, d): change of retract(state, t), in its tangent space, by t."""


class StateSpace(StateArithmetic, Protocol):
    """States are (..., s) arrays of s stored numbers, tangent vectors (..., d); positions (..., p) are those in map."""

    tangent_size: int  # d
    storage_size: int  # s
    frame_size: int  # f
    heading: ClassVar[int | None]  # tangent coordinate that turns a state in the plane; None: no single one does
    own_turn: ClassVar[int | None]  # tangent coordinate that turns a state about its own z; None: it does not turn
    attitude: ClassVar[slice | None]  # tangent coordinates of an attitude in space; None: it has none
    position_rows: slice  # p tangent coordinates that move a state, along its own axes
    origin: Array  # (s,) a rotated state; linearisation points are given as tangent steps from it
    relinearize_threshold: Array  # (d,) change of a state above which its factors are relinearised
    far: Array  # (d,) that threshold where updates are not iterated: larger for translations, which stay linear

    def __hash__(self) -> int:
        """Hash, so that results can be cached per space."""

    def along(self, start: Array, controls: Array) -> Array:
        """(..., T, s) states from ``start`` (..., s) after each of (..., T, s) controls, headings not wrapped."""

    def wrapped(self, state: Array) -> Array:
        """States with their headings wrapped to [-pi, pi)."""

    def between(self, state: Array, other: Array) -> Array:
        """``other`` as seen from ``state``."""

    def vertical(self, state: Array) -> Array:
        """(..., d) tangent vectors of a rotation by one radian about the vertical axis of map."""

    def mean(self, states: Array, weights: Array) -> Array:
        """(..., s) mean of (P, ..., s) states, of their positions in map and rotations, by (P,) normalised weights."""

    def propagation(self, control: Array) -> Array:
        """(..., d, d) error propagation matrix F of a control u: (x Exp(e)) u = (x u) Exp(F e)."""

    def position(self, state: Array) -> Array:
        """(..., p) positions of the states, metres in map."""

    def position_slopes(self, state: Array) -> Array:
        """(..., p, d) Jacobian of :meth:`position`."""

    def displacement(self, state: Array, point: Array, origin: Array) -> Array:
        """(..., q) vector along map's axes from ``origin`` (..., p) in map to ``point`` (..., q) in the state's frame.

        In the plane a third component, q = 3, is the height over it.
        """

    def turned_back(self, state: Array, vector: Array) -> Array:
        """(..., q) rotate a vector from map's axes to those of the state."""

    def in_frame(self, state: Array, point: Array) -> tuple[Array, Array, Array]:
        """(..., p) a point in map, in the state's frame; its Jacobians (..., p, d) by state, (..., p, p) by point."""

    def poses(self, states: Array) -> Array:
        """(..., 7) pose vectors of the states, as messages have them."""

    def covariances(self, states: Array, covariances: Array) -> Array:
        """(..., d, d) in the tangent spaces at the states to (..., 6, 6) along the axes of map, to first order."""

    def moments(self, states: Array, covariances: Array) -> Array:
        """(..., 6, 6) second moments about the states, along the axes of map: of robots, which err along arcs."""

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        """Insert one state (s,) into GTSAM values."""

    def state(self, values: gtsam.Values, key: int) -> Array:
        """(s,) state of the variable ``key`` in GTSAM's values."""

    def states(self, values: gtsam.Values) -> Array:
        """(n, s) of all variables of this type, by ascending key."""

    def prior_factors(self, key: int, mean: Array, covariance: Array) -> list[Any]:
        """Factors of a Gaussian prior; covariance in the tangent space at the mean."""

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        """Motion model P(x_k | x_{k-1}, u)."""
