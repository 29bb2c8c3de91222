"""Proposals of histories in which a static object moves, or a moving one stands still; replays then weigh them.

Objects are merged greedily by the evidence of their detections as one moving object against that of separate ones, with
the robot at its estimated path. That is rough, and only selects what is worth a replay.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.moving.moving_objects import rotation
from semantic_slam.inference.open_world.moving.placed_detections import PlacedDetections
from semantic_slam.inference.states.lineage import MOVES, Lineage, LineageStep, movers_of
from semantic_slam.inference.states.movers import Movers

MOST_DETECTIONS = 40
"""Number of detections beyond which an object is known to stand still or to move."""
LEAST_DETECTIONS = 3
LIKELY = 0.5
"""Probability of moving up to which an undecided object is proposed as standing still."""
ROBOT_SIGMA_M = 0.05
"""Standard deviation [m] of the robot's path between keyframes, in addition to detection errors."""

Group = tuple[int, ...]


@dataclass(frozen=True)
class Sightings:
    """The n detections of one or several objects, in the order of their keyframes."""

    keyframes: Index  # (n,)
    stamps_ns: Index  # (n,)
    places: Array  # (n, 2) in map
    variances: Array  # (n,) along x and along y

    def with_others(self, others: Self) -> "Sightings":
        """The sightings of both, in the order of their keyframes."""
        order = np.argsort(np.concatenate([self.keyframes, others.keyframes]), kind="stable")
        columns = zip(vars(self).values(), vars(others).values(), strict=True)
        return Sightings(*(np.concatenate(pair)[order] for pair in columns))


def mover_proposals(
    lineage: Lineage,
    steps: Sequence[Step],
    trail: Array,
    first_new: int,
    moving: Moving,
    birth_density: float,
    since: int = 0,
    sensor: Array | None = None,
) -> list[Group]:
    """Groups of objects, with ids from ``first_new`` on, that may be one moving object; largest gain first.

    ``trail`` (K, 3): the robot at the keyframes of ``steps``, whose detections have the noise that the history assumes.
    ``birth_density``: expected objects per square metre where nothing was seen yet.
    Objects not seen from keyframe ``since`` on are left out: all evidence of them was weighed before. ``sensor`` (d,):
    expected constant errors of the sensor, in units of their standard deviations; None: none are estimated.
    """
    every = _sightings(lineage, steps, trail, np.zeros(0) if sensor is None else moving.sensor_sigmas * sensor)
    seen = {n: own for n, own in every.items() if n >= first_new and own.keyframes[-1] >= since}
    groups: dict[Group, Sightings] = {(n,): own for n, own in seen.items() if len(own.stamps_ns) <= MOST_DETECTIONS}
    merging = _Merging(moving, float(np.log(birth_density)), groups)
    merging.run()
    known = movers_of(lineage)
    found = {
        group: merging.scores[group][1] - merging.apart[group]
        for group, own in groups.items()
        if len(own.stamps_ns) >= LEAST_DETECTIONS and not (len(group) == 1 and group[0] in known)
    }
    return sorted((group for group, value in found.items() if value > 0.0), key=lambda group: -found[group])


class _Merging:
    """Greedy merging of groups of objects, each taken as one object; ``groups`` change in place."""

    def __init__(self, moving: Moving, log_birth: float, groups: dict[Group, Sightings]) -> None:
        """``log_birth``: log density of births; detections have the same probability either way."""
        self.groups = groups
        self.scores = {group: _scores(own, moving, moving.largest_share) for group, own in groups.items()}
        self.apart = {group: max(own) for group, own in self.scores.items()}  # log evidence as separate objects
        self._moving, self._log_birth = moving, log_birth
        # Two sightings give no velocity: a third may.
        self._allowance = -float(np.log(moving.largest_share / np.sum(~moving.stands)))

    def run(self) -> None:
        """Merge the pair with the largest gain, until there is none."""
        gains = {pair: self._gain(*pair) for pair in combinations(sorted(self.groups), 2)}
        while gains and max(gains.values()) > 0.0:
            pair = max(gains, key=lambda each: gains[each])
            joined = self._merge(*pair)
            gains = {each: value for each, value in gains.items() if not set(each) & set(pair)}
            gains |= {(joined, other): self._gain(joined, other) for other in self.groups if other != joined}

    def _gain(self, one: Group, other: Group) -> float:
        """Log evidence ratio of one moving object to two objects; -inf where both are detected in a keyframe."""
        mine, theirs = self.groups[one], self.groups[other]
        if np.intersect1d(mine.keyframes, theirs.keyframes).size:
            return -np.inf
        known = any(self.scores[group][1] > self.scores[group][0] for group in (one, other))
        together = _scores(mine.with_others(theirs), self._moving, self._moving.largest_share)[1]
        gain = together - max(self.scores[one]) - max(self.scores[other]) - self._log_birth
        return gain + (0.0 if known else self._allowance)

    def _merge(self, one: Group, other: Group) -> Group:
        """Replace two groups by their union."""
        joined = tuple(sorted(one + other))
        self.groups[joined] = self.groups.pop(one).with_others(self.groups.pop(other))
        self.scores[joined] = _scores(self.groups[joined], self._moving, self._moving.largest_share)
        self.apart[joined] = self.apart[one] + self.apart[other] + self._log_birth
        return joined


def standing_proposals(lineage: Lineage, movers: Movers, since: int = 0) -> list[Group]:
    """Objects that a history takes to move and that may stand still, each by itself; the surest first.

    ``movers`` are of that history. Objects that were not seen from the keyframe ``since`` on are left out.
    """
    seen = {n for step in lineage[since:] for n in step.association}
    rows = np.flatnonzero(movers.decided & (movers.drives < LIKELY))
    surest = movers.ids[rows[np.argsort(movers.drives[rows], kind="stable")]].tolist()
    return [(n,) for n in surest if n in seen]


def with_standing(lineage: Lineage, group: Group) -> Lineage:
    """The history in which no object of a group moves."""

    def standing(step: LineageStep) -> LineageStep:
        pairs = zip(step.association, step.class_assignment, strict=True)
        return replace(step, class_assignment=tuple(-1 if n in group else kind for n, kind in pairs))

    return tuple(standing(step) for step in lineage)


def with_mover(lineage: Lineage, group: Group) -> Lineage:
    """The history in which all objects of a group are one moving object, the one seen first."""
    members, started = set(group), False
    steps: list[LineageStep] = []
    for step in lineage:
        association, kinds = list(step.association), list(step.class_assignment)
        for number, object_id in enumerate(step.association):
            if object_id in members:
                association[number] = min(group)
                kinds[number] = MOVES if started else -1
                started = True
        steps.append(replace(step, association=tuple(association), class_assignment=tuple(kinds)))
    return tuple(steps)


def _sightings(lineage: Lineage, steps: Sequence[Step], trail: Array, sensor: Array) -> Mapping[int, Sightings]:
    """Object -> its detections, corrected by the expected errors ``sensor`` (d,), range offset [m] and yaw [rad]."""
    rows: dict[int, list[tuple[int, int, Array, float]]] = {}
    for keyframe, (taken, step, robot) in enumerate(zip(lineage, steps, trail, strict=True)):
        if not len(step.detections):
            continue
        placed = PlacedDetections.of(step.detections, sensor)
        points = placed.without_sensor_errors(np.arange(len(placed.points)), np.ones((len(placed.points), len(sensor))))
        places = robot[:2] + points @ rotation(robot[None])[0].T
        variances = 0.5 * np.trace(placed.covariances, axis1=1, axis2=2) + ROBOT_SIGMA_M**2
        for number in np.flatnonzero(placed.has_range).tolist():
            own = (keyframe, step.stamp_ns, places[number], float(variances[number]))
            rows.setdefault(taken.association[number], []).append(own)
    return {n: Sightings(*(np.array(column) for column in zip(*own, strict=True))) for n, own in rows.items()}


def _scores(seen: Sightings, moving: Moving, share: float) -> tuple[float, float]:
    """Log weights of all detections but the first, as of a static object and as of a moving one."""
    speeds = np.concatenate([[0.0], moving.speeds[~moving.stands]])
    place = np.full(len(speeds), seen.variances[0])
    both, rate = np.zeros(len(speeds)), speeds**2
    mean, drift = np.tile(seen.places[0], (len(speeds), 1)), np.zeros((len(speeds), 2))
    total = np.zeros(len(speeds))
    for row in range(1, len(seen.stamps_ns)):
        elapsed_s = (seen.stamps_ns[row] - seen.stamps_ns[row - 1]) / 1e9
        transition, noise = moving.unit_transition(elapsed_s), moving.unit_noise(elapsed_s)
        a, keeps = transition[0, 1], transition[1, 1]
        mean, drift = mean + a * drift, keeps * drift
        place = place + 2.0 * a * both + a * a * rate + noise[0, 0] * speeds**2
        both, rate = keeps * (both + a * rate) + noise[0, 1] * speeds**2, keeps**2 * rate + noise[1, 1] * speeds**2
        apart, spread = seen.places[row] - mean, place + seen.variances[row]
        total += -np.log(2.0 * np.pi * spread) - 0.5 * (apart**2).sum(axis=1) / spread
        mean, drift = mean + (place / spread)[:, None] * apart, drift + (both / spread)[:, None] * apart
        place, both, rate = place - place**2 / spread, both - place * both / spread, rate - both**2 / spread
    moves = float(np.logaddexp.reduce(total[1:])) - np.log(len(speeds) - 1) + np.log(share)
    return float(total[0] + np.log1p(-share)), float(moves)
