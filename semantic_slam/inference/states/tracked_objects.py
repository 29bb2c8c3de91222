"""The objects of one hypothesis: how surely each exists and, where objects come and go, where each is by now."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.states.carried_errors import CarriedErrors
from semantic_slam.inference.states.detection_rates import CERTAIN, DetectionRates

BEYOND = 1e6
"""Metres to where nothing is ever seen."""
TRAIL_CELL, LOOKS_FROM_A_PLACE = np.array([0.5, 0.5, 0.5]), 4
"""Metres and radians within which poses of long ago are one place, and how many looks from one count."""


@dataclass(frozen=True, kw_only=True)
class HypothesisObjects:
    """O objects, ascending by id; in a world of known objects their existence is what the map states.

    Whether they exist depends on what the sensor is taken to detect: G settings, with weights of their own.
    """

    ids: Index  # (O,)
    existence_given: Array  # (O, G)
    detectable: Array | None = None  # (O, G) probability that it can be detected next, if it exists; None: always
    gone: Array | None = None  # (O, G) probability that it was there and has left since; None: nothing leaves
    stamp_ns: int | None = None  # time of which that is said; None: before the first keyframe
    rates: DetectionRates = CERTAIN

    @cached_property
    def existence(self) -> Array:
        """(O,) over all settings."""
        return self.rates.average(self.existence_given)

    @cached_property
    def id_set(self) -> frozenset[int]:
        """Ids, to ask whether one is among them."""
        return frozenset(self.ids.tolist())

    def rows(self, object_ids: Index) -> Index:
        """Where (n,) objects stand; all of them must be there."""
        return np.asarray(np.searchsorted(self.ids, object_ids))

    def left_until(
        self, stamp_ns: int, departures_per_hour: Array | float, moving: Array | float = 0.0
    ) -> "HypothesisObjects":
        """The objects as time leaves them: each that stands departs for good at a constant rate, (O, 1) or of all.

        ``moving`` (O, G) is the probability that one moves, if it exists: it then is somewhere.
        """
        if self.gone is None:
            return self
        elapsed_s = 0.0 if self.stamp_ns is None else max(stamp_ns - self.stamp_ns, 0) / 1e9
        stays = np.exp(-departures_per_hour * elapsed_s / 3600.0)
        stays = stays + (1.0 - stays) * moving
        leaving = (1.0 - stays) * self.existence_given
        return replace(self, existence_given=stays * self.existence_given, gone=self.gone + leaving, stamp_ns=stamp_ns)

    def updated(self, update: "ExistenceUpdate") -> "HypothesisObjects":
        """The objects after one keyframe; the table itself where nothing comes, goes or changes."""
        if update.changes_nothing:
            return self
        return HypothesisObjects(
            ids=np.concatenate([self.ids[update.kept], update.new_ids]),
            existence_given=np.concatenate([update.existence[update.kept], update.new_existence]),
            detectable=update.detectable,
            gone=None
            if update.gone is None
            else np.concatenate([update.gone[update.kept], 0.0 * update.new_existence]),
            stamp_ns=update.stamp_ns,
            rates=update.rates,
        )


@dataclass(frozen=True, kw_only=True)
class TrackedStates:
    """Where robot and O objects were after the newest update; r and l dimensions of tangent spaces, T keyframes.

    Kept where objects come and go, because reading every marginal anew costs more than everything else.
    """

    states: Array  # (O, s)
    covariances: Array  # (O, l, l) when the object was last near: later updates only narrow it
    sigmas: Array  # (O,) largest standard deviation of a position then, metres
    robot: Array  # (s,)
    robot_covariance: Array  # (r, r)
    trail: Array  # (T, s) robot at each keyframe, as estimated then; where the past is summarised few of each place
    bias: Array = field(default_factory=lambda: np.zeros(0))  # (p,) of odometry
    errors: CarriedErrors | None = None  # of detections, that repeat; q components; None: q is 0
    anchors: Array | None = (
        None  # (O, 3) from where objects were first seen along a ray alone, NaN of others; None: all
    )
    carried_covariance: Array | None = None  # (r + p + q) square, of robot, bias and errors; None: p and q are 0

    @property
    def motion_covariance(self) -> Array:
        """(r + p + q) square, of the newest robot, what odometry always gets wrong, and the errors that repeat."""
        return self.robot_covariance if self.carried_covariance is None else self.carried_covariance

    @property
    def bias_sigmas(self) -> Array:
        """(p,) standard deviations of the bias."""
        first = len(self.robot_covariance)
        return np.asarray(np.sqrt(np.diagonal(self.motion_covariance)[first : first + len(self.bias)]))

    @property
    def clock(self) -> tuple[float, float]:
        """Mean and standard deviation of the last bias, that of odometry's clock, in those of its prior."""
        return float(self.bias[-1]), float(self.bias_sigmas[-1])

    def with_thinned_trail(self, num_newest: int) -> "TrackedStates":
        """The trail's newest poses, and of those before them the newest few of each place."""
        places = np.floor(self.trail[:, :3] / TRAIL_CELL).astype(int)
        _, cells = np.unique(places, axis=0, return_inverse=True)
        order = np.argsort(cells, kind="stable")[::-1]  # cell by cell, the newest first
        begins = np.flatnonzero(np.diff(cells[order], prepend=-1))
        newer = np.arange(len(order)) - begins[np.searchsorted(begins, np.arange(len(order)), side="right") - 1]
        kept = np.zeros(len(order), dtype=bool)
        kept[order] = newer < LOOKS_FROM_A_PLACE
        kept[len(kept) - num_newest :] = True
        return replace(self, trail=self.trail[kept])

    def with_trail_left_behind(self) -> "TrackedStates":
        """The trail beyond all that the sensor sees from now on."""
        return replace(self, trail=self.trail + BEYOND * np.eye(self.trail.shape[1])[0])

    @property
    def sensor(self) -> Array | None:
        """(d, 2) means and standard deviations of what the sensor always gets wrong; None where nothing is known."""
        if self.errors is None or self.carried_covariance is None or not self.errors.by_sensor.size:
            return None
        first = len(self.errors.by_sensor)
        spread = np.sqrt(np.diagonal(self.carried_covariance)[len(self.carried_covariance) - self.num_errors + first :])
        return np.stack([self.errors.mean[first:], spread], axis=1)

    @property
    def num_errors(self) -> int:
        """q."""
        return 0 if self.errors is None else len(self.errors.mean)


@dataclass(frozen=True, kw_only=True)
class ExistenceUpdate:
    """What one continuation makes of the existence of its parent's O objects, and of those that it starts."""

    existence: Array  # (O, G) after this keyframe, given each setting of the sensor that is left
    kept: Flags  # (O,)
    new_ids: Index  # (n,) ascending, above all of the parent's
    new_existence: Array  # (n, G)
    rates: DetectionRates = CERTAIN  # those settings
    rates_kept: Flags | None = None  # which of the parent's they are; None: all
    detectable: Array | None = None  # of those kept, and then of the new ones, where misses come in runs
    gone: Array | None = None  # (O, G) probability that it has left, where objects do
    stamp_ns: int | None = None  # of this keyframe, where objects leave
    moving: Array | None = None  # (O, G) probability that it moves, if it was missed; None: nothing does
    changes_nothing: bool = False

    def detecting(self, seen: Flags, excluded: Flags) -> "ExistenceUpdate":
        """The update where (O,) some objects are detected, which then surely exist, and others therefore do not."""
        after = np.where(seen[:, None], 1.0, np.where(excluded[:, None], 0.0, self.existence))
        same = self.changes_nothing and bool((after == self.existence).all())
        return replace(self, existence=after, changes_nothing=same)

    @classmethod
    def starting(cls, objects: HypothesisObjects, new_ids: list[int]) -> "ExistenceUpdate":
        """Update in a world where objects surely exist: nothing goes, and ``new_ids`` come."""
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
