"""The objects of one hypothesis: existence probabilities and, in an open world, tracked states and covariances."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.states.detection_rates import CERTAIN, DetectionRates
from semantic_slam.inference.states.in_view import InViewRecord
from semantic_slam.inference.states.propagated_errors import PropagatedErrors
from semantic_slam.inference.states.track_scores import false_alarm_probability, log_odds

BEYOND = 1e6
"""Metres to a position that the sensor never sees."""
TRAIL_CELL, LOOKS_FROM_A_PLACE = 0.5, 4
"""Cell size [m or rad] in which old poses of the trail count as one place, and how many are kept of each place."""
PLANAR = 3
"""Numbers of a pose in the plane; in space there are 7."""


@dataclass(frozen=True, kw_only=True)
class HypothesisObjects:
    """Existence of O objects, ascending by id; in a closed world it is what the map states.

    Existence depends on the sensor's detection rates, of which there are G settings with weights of their own.
    """

    ids: Index  # (O,)
    existence_given: Array  # (O, G) probability of existence under each setting
    in_view: InViewRecord | None = None  # what detections and misses say of being in view; None: misses do not count
    gone: Array | None = None  # (O, G) probability that it existed and has left since; None: nothing leaves
    stamp_ns: int | None = None  # time to which departures are accounted for; None: before the first keyframe
    rates: DetectionRates = CERTAIN
    track_scores: Array | None = None  # (O, G) nats, see ``track_scores``; None: misses do not count

    @cached_property
    def existence(self) -> Array:
        """(O,) probability of existence, averaged over all settings."""
        return self.rates.average(self.existence_given)

    @property
    def missing(self) -> Array | None:
        """(O,) probability that an object has left, averaged over all settings; None: nothing leaves."""
        return None if self.gone is None else self.rates.average(self.gone)

    @property
    def track_score(self) -> Array | None:
        """(O,) track scores of which the probabilities of false alarms are averaged over all settings, in nats."""
        if self.track_scores is None:
            return None
        return -log_odds(self.rates.average(false_alarm_probability(self.track_scores)))

    @cached_property
    def id_set(self) -> frozenset[int]:
        """The ids as a set."""
        return frozenset(self.ids.tolist())

    def rows(self, object_ids: Index) -> Index:
        """Rows of (n,) object ids, all of which must be in the table."""
        return np.asarray(np.searchsorted(self.ids, object_ids))

    def scored(self) -> "HypothesisObjects":
        """The objects with the track scores of their existence, as stated before any detection."""
        gone = 0.0 if self.gone is None else self.gone
        return replace(self, track_scores=log_odds(self.existence_given + gone))

    def left_until(
        self, stamp_ns: int, departures_per_hour: Array | float, moving: Array | float = 0.0
    ) -> "HypothesisObjects":
        """Predict existence to a time: static objects leave for good at a constant rate, (O, 1) or one for all.

        ``moving`` (O, G) is the probability that an object moves, if it exists: movers do not leave.
        """
        if self.gone is None:
            return self
        elapsed_s = 0.0 if self.stamp_ns is None else max(stamp_ns - self.stamp_ns, 0) / 1e9
        stays = np.exp(-departures_per_hour * elapsed_s / 3600.0)
        stays = stays + (1.0 - stays) * moving
        leaving = (1.0 - stays) * self.existence_given
        return replace(self, existence_given=stays * self.existence_given, gone=self.gone + leaving, stamp_ns=stamp_ns)

    def updated(self, update: "ExistenceUpdate") -> "HypothesisObjects":
        """The objects after the update of one keyframe; the table itself if nothing changes."""
        if update.changes_nothing:
            return self
        return HypothesisObjects(
            ids=np.concatenate([self.ids[update.kept], update.new_ids]),
            existence_given=np.concatenate([update.existence[update.kept], update.new_existence]),
            in_view=update.in_view,
            gone=None
            if update.gone is None
            else np.concatenate([update.gone[update.kept], 0.0 * update.new_existence]),
            stamp_ns=update.stamp_ns,
            rates=update.rates,
            track_scores=None
            if update.track_scores is None
            else np.concatenate([update.track_scores[update.kept], log_odds(update.new_existence)]),
        )


@dataclass(frozen=True, kw_only=True)
class TrackedStates:
    """Cache of the marginals of robot and O objects after the newest update; tangent spaces of r and l, T keyframes.

    It is kept in an open world, because reading all marginals from the smoother anew costs more than everything else.
    """

    states: Array  # (O, s)
    covariances: Array  # (O, l, l) as read when the object was last near: conservative, as updates only narrow it
    sigmas: Array  # (O,) largest standard deviation of a position then, metres
    robot: Array  # (s,)
    robot_covariance: Array  # (r, r)
    trail: Array  # (T, s) robot at each keyframe, as estimated then; thinned where the past is marginalised
    bias: Array = field(default_factory=lambda: np.zeros(0))  # (p,) of odometry
    errors: PropagatedErrors | None = None  # correlated errors of detections, q components; None: q is 0
    anchors: Array | None = (
        None  # (O, 3) ray origins of objects first seen by bearing alone, NaN for others; None: all are others
    )
    propagated_covariance: Array | None = None  # (r + p + q) square, of robot, bias and errors; None: p and q are 0

    @property
    def motion_covariance(self) -> Array:
        """(r + p + q) square covariance of the newest robot pose, the odometry biases and the correlated errors."""
        return self.robot_covariance if self.propagated_covariance is None else self.propagated_covariance

    @property
    def bias_sigmas(self) -> Array:
        """(p,) standard deviations of the bias."""
        first = len(self.robot_covariance)
        return np.asarray(np.sqrt(np.diagonal(self.motion_covariance)[first : first + len(self.bias)]))

    @property
    def clock(self) -> tuple[float, float]:
        """Mean and sigma of the last bias, the clock offset of odometry, in units of its prior standard deviation."""
        return float(self.bias[-1]), float(self.bias_sigmas[-1])

    def with_thinned_trail(self, num_newest: int) -> "TrackedStates":
        """The states with a thinned trail: its ``num_newest`` poses, and of the older ones the newest few per place."""
        places = np.floor(_places_and_turns(self.trail) / TRAIL_CELL).astype(int)
        _, cells = np.unique(places, axis=0, return_inverse=True)
        order = np.argsort(cells, kind="stable")[::-1]  # cell by cell, the newest first
        begins = np.flatnonzero(np.diff(cells[order], prepend=-1))
        newer = np.arange(len(order)) - begins[np.searchsorted(begins, np.arange(len(order)), side="right") - 1]
        kept = np.zeros(len(order), dtype=bool)
        kept[order] = newer < LOOKS_FROM_A_PLACE
        kept[len(kept) - num_newest :] = True
        return replace(self, trail=self.trail[kept])

    def with_trail_left_behind(self) -> "TrackedStates":
        """The states with the trail moved beyond all that the sensor will see (after the robot was carried away)."""
        return replace(self, trail=self.trail + BEYOND * np.eye(self.trail.shape[1])[0])

    @property
    def sensor(self) -> Array | None:
        """(d, 2) means and standard deviations of the sensor's constant errors; None if they are not estimated."""
        mean, covariance = self.constant_errors
        if not len(mean):
            return None
        return np.stack([mean, np.sqrt(np.diagonal(covariance[:, -len(mean) :]))], axis=1)

    @property
    def constant_errors(self) -> tuple[Array, Array]:
        """(d,) means of the sensor's constant errors, and their (d, r + d) covariance with robot and each other.

        d is 0 if they are not estimated.
        """
        size = len(self.robot_covariance)
        count = 0 if self.errors is None else self.errors.by_sensor.shape[1]
        if self.errors is None or self.propagated_covariance is None or not count:
            return np.zeros(0), np.zeros((0, size))
        rows = self.propagated_covariance[-count:]
        return self.errors.mean[-count:], np.concatenate([rows[:, :size], rows[:, -count:]], axis=1)

    @property
    def num_errors(self) -> int:
        """Number q of components of the correlated errors."""
        return 0 if self.errors is None else len(self.errors.mean)


@dataclass(frozen=True, kw_only=True)
class ExistenceUpdate:
    """Effect of one candidate on existence: of its parent's O objects, and of the n objects born."""

    existence: Array  # (O, G) after this keyframe, under each sensor setting that is left
    kept: Flags  # (O,) objects that are kept; the others are removed
    new_ids: Index  # (n,) ascending, above all of the parent's
    new_existence: Array  # (n, G)
    rates: DetectionRates = CERTAIN  # the settings that are left
    rates_kept: Flags | None = None  # which of the parent's settings these are; None: all
    in_view: InViewRecord | None = None  # of the kept objects, then of the new ones; None: misses do not count
    gone: Array | None = None  # (O, G) probability that it has left, where departures are modelled
    stamp_ns: int | None = None  # of this keyframe, where departures are modelled
    moving: Array | None = None  # (O, G) probability that it moves, if it was missed; None: nothing moves
    track_scores: Array | None = None  # (O, G) after this keyframe, under each setting that is left
    changes_nothing: bool = False

    def agreeing(self, rows: Index, log_densities: Array) -> "ExistenceUpdate":
        """The update with (n,) log densities of the detections of the objects ``rows`` (n,) in their track scores."""
        assert self.track_scores is not None
        scores = self.track_scores.copy()
        scores[rows] += log_densities[:, None]
        return replace(self, track_scores=scores)

    def detecting(self, seen: Flags, excluded: Flags) -> "ExistenceUpdate":
        """The update with objects ``seen`` (O,) surely existing, and ``excluded`` (O,) ones therefore not existing."""
        after = np.where(seen[:, None], 1.0, np.where(excluded[:, None], 0.0, self.existence))
        same = self.changes_nothing and bool((after == self.existence).all())
        return replace(self, existence=after, changes_nothing=same)

    @classmethod
    def starting(cls, objects: HypothesisObjects, new_ids: list[int]) -> "ExistenceUpdate":
        """Update of a closed world, where objects surely exist: nothing is removed, and ``new_ids`` are added."""
        count = len(objects.ids)
        new = np.array(sorted(new_ids), dtype=int)
        return cls(
            existence=objects.existence_given,
            kept=np.ones(count, dtype=bool),
            new_ids=new,
            new_existence=np.ones((len(new), len(objects.rates))),
            rates=objects.rates,
            changes_nothing=not len(new),
        )


def _places_and_turns(poses: Array) -> Array:
    """(T, k) metres and radians of poses (T, s): x, y, yaw in the plane; in space positions and rotation vectors."""
    if poses.shape[1] == PLANAR:
        return poses
    return np.concatenate([poses[:, :3], so3.log(poses[:, 3:])], axis=1)
