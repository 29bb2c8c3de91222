"""Moving (or possibly moving) objects of one hypothesis, tracked as a few Gaussians each, outside the smoother.

A state is x, y [m] and velocity [m/s] in map, and the correlated part of its detections' errors, two numbers of unit
variance along range and bearing. It is conditional on the observer, the robot and its sensor's constant errors: state =
mean + gain d + e, where d is the tangent vector from the observer's reference to its true state, and e has covariance
``spreads`` and is independent of the observer. Later corrections of the observer thus carry over to the object, but not
the other way round.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.states.observers import Observers
from semantic_slam.inference.states.tracked_objects import HypothesisObjects

STATE = 6
"""Dimension of a state."""
UNDECIDED = 1.0 - 1e-9
"""Largest probability of being a mover of an object for which the hypothesis has not decided it."""


@dataclass(frozen=True, kw_only=True)
class Movers:
    """T moving objects, ascending by id, each a mixture over S speed hypotheses; under some of these it stands still.

    An object that was seen once may also be static: it is then in the static table under the same id, too, with the
    same existence and detectability, and is a mover with probability ``moving``.
    """

    stamp_ns: int
    robot: Array  # (3,) reference pose
    sensor: Array  # (d,) reference constant errors of the sensor
    stands: Flags  # (S,) speed hypotheses under which a mover stands still
    ids: Index  # (T,)
    moving: Array  # (T, G) probability of being a mover, if it exists; 1 where that is decided
    existence: Array  # (T, G) for each of G sensor settings
    detectable: Array | None  # (T, G) probability that it can be detected next; None: always
    log_speeds: Array  # (T, S) log probabilities of the speed hypotheses
    means: Array  # (T, S, 6)
    gains: Array  # (T, S, 6, 3 + d) Jacobians by the observer
    spreads: Array  # (T, S, 6, 6) covariances given the observer

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def none(cls, stands: Flags, num_rates: int, misses_in_runs: bool, num_sensor: int) -> "Movers":
        """The empty table, before the first detection; ``stands`` (S,); ``num_sensor`` d."""
        num_speeds = len(stands)
        return cls(
            stamp_ns=0,
            robot=np.zeros(3),
            sensor=np.zeros(num_sensor),
            stands=stands,
            ids=np.zeros(0, dtype=int),
            moving=np.zeros((0, num_rates)),
            existence=np.zeros((0, num_rates)),
            detectable=np.zeros((0, num_rates)) if misses_in_runs else None,
            log_speeds=np.zeros((0, num_speeds)),
            means=np.zeros((0, num_speeds, STATE)),
            gains=np.zeros((0, num_speeds, STATE, 3 + num_sensor)),
            spreads=np.zeros((0, num_speeds, STATE, STATE)),
        )

    @cached_property
    def decided(self) -> Flags:
        """(T,) whether the hypothesis has decided that the object is a mover."""
        return np.asarray((self.moving >= 1.0).all(axis=1))

    @cached_property
    def decided_ids(self) -> frozenset[int]:
        """Ids of the decided movers."""
        return frozenset(self.ids[self.decided].tolist())

    @cached_property
    def drives(self) -> Array:
        """(T,) probability that it actually moves, if it is a mover."""
        return np.asarray(np.exp(self.log_speeds[:, ~self.stands]).sum(axis=1))

    def rows(self, object_ids: Index) -> Index:
        """Rows of (n,) object ids, all of which must be in the table."""
        return np.asarray(np.searchsorted(self.ids, object_ids))

    def take(self, rows: Index | Flags) -> "Movers":
        """Some of the movers."""
        some: dict[str, Any] = {name: getattr(self, name)[rows] for name in _PER_OBJECT if _is_known(self, name)}
        return replace(self, **some)

    def joined(self, others: "Movers") -> "Movers":
        """The table joined with ``others`` of the same stamp and reference pose, whose ids are larger."""
        both: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(others, name)])
            for name in _PER_OBJECT
            if _is_known(self, name)
        }
        return replace(self, **both)

    def among(self, before: HypothesisObjects, after: HypothesisObjects) -> "Movers":
        """Update undecided movers after departures from the static table, ``before`` to ``after``.

        Only static objects leave, so that an object that still exists is a mover with a larger probability.
        """
        rows = before.rows(self.ids[~self.decided])
        moving, existence = self.moving.copy(), self.existence.copy()
        existence[~self.decided] = after.existence_given[rows]
        known = np.maximum(existence[~self.decided], np.finfo(float).tiny)
        moving[~self.decided] *= before.existence_given[rows] / known
        moving[~self.decided] = np.minimum(moving[~self.decided], UNDECIDED)
        return replace(self, moving=moving, existence=existence)

    def with_rates(self, kept: Flags | None) -> "Movers":
        """The movers under the sensor settings ``kept`` (G,) only; None: under all."""
        if kept is None:
            return self
        some: dict[str, Any] = {name: getattr(self, name)[:, kept] for name in _PER_RATE if _is_known(self, name)}
        return replace(self, **some)

    def seen_from(self, observer: Observers) -> "Movers":
        """The movers relative to another reference: that of the one ``observer``."""
        robot, sensor = observer.robots[0], observer.sensors[0]
        shift = np.concatenate([se2.log(se2.between(self.robot, robot)), sensor - self.sensor])
        return replace(self, robot=robot, sensor=sensor, means=self.means + self.gains @ shift)

    def moments(self, observer_covariance: Array) -> tuple[Array, Array]:
        """(T, 6) means and (T, 6, 6) covariances over the speeds, for an observer with its mean at the reference."""
        share = np.exp(self.log_speeds)
        mean = np.einsum("ts,tsi->ti", share, self.means)
        apart = self.means - mean[:, None]
        by_robot = self.gains @ observer_covariance @ np.swapaxes(self.gains, -1, -2)
        within = self.spreads + by_robot + apart[..., :, None] * apart[..., None, :]
        return mean, np.einsum("ts,tsij->tij", share, within)


_PER_OBJECT = ("ids", "moving", "existence", "detectable", "log_speeds", "means", "gains", "spreads")
_PER_RATE = ("moving", "existence", "detectable")


def _is_known(movers: Movers, name: str) -> bool:
    return getattr(movers, name) is not None
