"""A robot that was carried in mid-drive: histories in which it was, from a keyframe that the belief did not expect on.

Where a keyframe was likelier under the reference model than under the belief, the robot may have been carried just
before. From then on its detections, placed by odometry alone, are fitted to what it had mapped until then. The
likeliest poses are replayed, a few keyframes at a time, and enter with P(history, Z_1:k), as those of a lost robot do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.models.planar_detection import PlanarDetection
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.relocation.alike import log_alike
from semantic_slam.inference.relocation.likelihood_field import LikelihoodField
from semantic_slam.inference.relocation.new_ground import NewGround
from semantic_slam.inference.revision.replay import Lineage, Progress, Replay, Revised
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.world.carried import FIRST_POINT, carried_to, new_grounds
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.starts import Starts

LOOKS = (3, 6, 10, 15, 20, 27, 35)
"""Keyframes after an unexpected one after which to look where the robot may have been carried to."""
SOON = 40
"""Keyframes in which the robot is not carried twice, while there is a history in which it is not."""
PLACES = 24
"""Poses that are replayed in one look."""
AHEAD, HOPELESS = 2, 12.0
"""Keyframes that places are replayed at a time, and nats behind the best of them from which on one is given up."""
NEWEST = 12
"""Keyframes whose detections are fitted by themselves, too: it may take long until something mapped comes into view."""
MARGIN = 3.0
"""Nats below what would enter that a history is weighed exactly: what it weighs is told roughly."""
LEAST_OBJECTS = 2
"""Objects of its own from which on a robot on new ground may be placed by them."""
LEAST_SEEN = 3
"""Detections from which on the robot may be found by them."""
LARGEST_SIGMA_M, LEAST_EXISTENCE = 1.0, 0.3
"""Standard deviation of an object that tells where the robot is, and how likely it exists at least."""
REACH_SIGMAS = 3.0
STEPS_PER_KEYFRAME = 40
"""Keyframes that are replayed in one, all places together."""


@dataclass
class _Suspect:
    """A keyframe before which the robot may have been carried."""

    log_ratio: float  # of it and those after it that were unexpected, too, reference to belief
    looks: int = 0  # of those due that are over
    num_seen: int = 0  # detections since, at the last of them


class Recovery:
    """Proposes and weighs histories in which the robot was carried."""

    def __init__(self, replay: Replay, registry: ObjectRegistry) -> None:
        self._replay, self._registry = replay, registry
        self._new_ground = NewGround(replay) if replay.association.tracks_objects else None
        self._begun = 0  # keyframes before which suspects have been followed
        self.origins: dict[int, Array] = {}  # (3,) before each keyframe from which on a history is on new ground
        self._num_noted = 0  # keyframes
        self._misfit: _Suspect | None = None  # that goes on
        self._suspects: dict[int, _Suspect] = {}  # by keyframe before which the robot may have been carried
        self._waiting: list[Progress] = []
        self._looked_at = 0  # keyframe of the suspect whose places wait
        self._log_best = self._log_ratio = 0.0  # log P(history, Z_1:k) of the best live one, and what enters beside it

    @property
    def is_on(self) -> bool:
        """Whether the robot may be carried."""
        return self._replay.problem.carried is not None

    def note(self, log_ratio: float) -> None:
        """Note how much likelier the newest keyframe was under the reference than under the belief, in nats."""
        if not self.is_on:
            return
        if log_ratio > 0.0:
            self._misfit = self._misfit or _Suspect(0.0)
            self._misfit.log_ratio += log_ratio
            if self._num_noted and self._misfit.log_ratio == log_ratio:
                self._suspects[self._num_noted] = self._misfit
        else:
            self._misfit = None
        self._num_noted += 1

    def found(self, live: Mapping[int, Hypothesis], log_evidence: float, ratio: float) -> dict[int, Hypothesis]:
        """New hypotheses that weigh at least the ``ratio``-th part of the best live one.

        ``log_evidence``: what weights are relative to.
        """
        if not self.is_on:
            return {}
        best = next(iter(live.values()))
        self._log_best, self._log_ratio = best.log_weight + log_evidence, float(np.log(ratio))
        self._follow(live)
        due = self._due()
        if due is not None:
            self._look(due, live)
        caught_up = [own for own in [*self._caught_up(), *self._on_new_ground()] if own.number not in live]
        if not caught_up:
            return {}
        (followed,) = self._replay.log_joints([best.lineage])
        if followed is None:
            return {}
        known = {_told(own.lineage) for own in live.values()}
        gains = {own.number: own.log_joint - followed.log_joint for own in caught_up if _told(own.lineage) not in known}
        return {
            own.number: Hypothesis(
                owner=best.owner,
                log_weight=best.log_weight + gains[own.number],
                parent_id=own.parent_id,
                lineage=own.lineage,
                revises=best,
                replayed=own.component,
            )
            for own in caught_up
            if gains.get(own.number, -np.inf) >= -float(np.log(ratio))
        }

    def frame(self, grounds: Sequence[int]) -> Starts:
        """Where the frame may lie of a robot that was set down on new ground before some keyframes."""
        assert self._replay.problem.carried is not None
        return self._replay.problem.carried.frame(self.origins[grounds[0]], len(grounds))

    def _follow(self, live: Mapping[int, Hypothesis]) -> None:
        """Follow the robot on new ground from the suspects on."""
        if self._new_ground is None:
            return
        for since in sorted(at for at in self._suspects if at >= self._begun):
            before = self._new_ground.begin(self._not_carried_lately(live, since), since)
            self.origins |= {since: before} if before is not None else {}
        self._begun = self._num_noted
        self._new_ground.go_on(self._log_best)
        live_grounds = {at for own in live.values() for at in new_grounds(own.lineage)}
        followed = {own.since for own in self._new_ground.followed}
        self._suspects = {at: own for at, own in self._suspects.items() if at in followed}
        self.origins = {at: own for at, own in self.origins.items() if at in followed | live_grounds}

    def _on_new_ground(self) -> list[Revised]:
        """The histories in which the robot is on new ground that may weigh enough."""
        if self._new_ground is None:
            return []
        least = self._log_best - self._log_ratio - MARGIN
        return [
            self._replay.finished(replace(own.progress, component=own.progress.component.fork()))
            for own in self._new_ground.followed
            if own.progress.log_joint >= least
        ]

    def _due(self) -> int | None:
        """The most promising of the keyframes that are to be looked at now, if it is more so than what waits."""
        now = len(self._replay.steps)
        self._suspects = {at: own for at, own in self._suspects.items() if own.looks < len(LOOKS)}
        due = {at: own for at, own in self._suspects.items() if now - at > LOOKS[own.looks]}
        promises = {at: self._promise(at) for at in due}
        at = max(due, key=lambda at: promises[at], default=None)
        if at is None or promises[at] <= (self._promise(self._looked_at) if self._waiting else -np.inf):
            return None
        return at

    def _promise(self, since: int) -> float:
        """How likely the robot was carried before a keyframe, where it may be placed by what it saw since; or -inf.

        Among objects that all are on the map: how unexpected that keyframe was.
        """
        if self._new_ground is None:
            return self._suspects[since].log_ratio if since in self._suspects else -np.inf
        carried = self._replay.problem.carried
        own = self._new_ground.at(since)
        if own is None or carried is None or own.num_recognisable < LEAST_OBJECTS:
            return -np.inf
        is_promising = own.log_most(carried.log_place) >= self._log_best - self._log_ratio
        return own.progress.log_joint if is_promising else -np.inf

    def _not_carried_lately(self, live: Mapping[int, Hypothesis], since: int) -> Lineage:
        """The likeliest history in which the robot was not carried lately before a keyframe, or else the likeliest."""
        lately = slice(max(since - SOON, 1), since)
        lineages = [own.lineage for own in live.values() if not any(map(carried_to, own.lineage[lately]))]
        return [*lineages, next(iter(live.values())).lineage][0]

    def _look(self, since: int, live: Mapping[int, Hypothesis]) -> None:
        """Begin to replay histories in which the robot was carried just before a keyframe."""
        now, carried = len(self._replay.steps), self._replay.problem.carried
        assert carried is not None
        self._looked_at, self._waiting = since, []
        suspect, num_seen = self._suspects[since], sum(len(step.detections) for step in self._replay.steps[since:])
        suspect.looks = sum(now - since > apart for apart in LOOKS)
        if num_seen == suspect.num_seen:
            return
        suspect.num_seen = num_seen
        before = self._replay.before(self._not_carried_lately(live, since), since)
        if before is None:
            return
        robot, half = before.component.newest_robot()[:3], PLACES // 2
        poses = self._poses(before.component, since, since, PLACES if now - since <= NEWEST else half)
        if now - since > NEWEST:
            poses = np.concatenate([poses, self._poses(before.component, since, now - NEWEST, half)])
        points = dict.fromkeys(carried.point(se2.between(robot, pose)) for pose in poses)
        for point in points:
            if point is None:
                continue
            try:
                self._waiting.append(self._replay.carried(before, point))
            except LostComponentError:
                continue

    def _poses(self, component: Component, since: int, begin: int, most: int) -> Array:
        """(P, 3) poses at keyframe ``since`` from which what is seen from ``begin`` on fits what was mapped.

        The component is that before ``since``.
        """
        carried, path = self._replay.problem.carried, _path(self._replay.steps[since:])
        places, seen = _seen(self._replay.steps[begin:], path[begin - since :])
        ids, points, sigmas = _known_well(component)
        if len(seen) < LEAST_SEEN or not ids or carried is None:
            return np.zeros((0, 3))
        robot, variance = component.newest_robot()[:3], float(carried.motions.covariance[0, 0])
        prior = self._registry.log_class_prior_of(ids)
        alike = log_alike(self._replay.problem.viewpoint, component, ids, prior, seen)
        reach_m = float(np.hypot(*places.T).max())
        field = LikelihoodField.of(robot[:2], REACH_SIGMAS * float(np.sqrt(variance)), reach_m, points, sigmas, alike)
        return field.likeliest(places, lambda poses: -0.5 * squared_norms(poses[..., :2] - robot[:2]) / variance, most)

    def _caught_up(self) -> list[Revised]:
        """The histories that are through, after some keyframes more of those that wait: the best of them.

        They go on together, and those that fall behind are given up.
        """
        left, now = STEPS_PER_KEYFRAME, len(self._replay.steps)
        while self._waiting and left > 0:
            first = min(own.at for own in self._waiting)
            if first == now:
                break
            left -= sum(own.at == first for own in self._waiting) * min(AHEAD, now - first)
            group = [self._ahead(own, first) for own in self._waiting]
            self._waiting = _likely(group, self._log_unplaced(min(first + AHEAD, now)))
        if not self._waiting or self._waiting[0].at < now:
            return []
        through, self._waiting = self._waiting, []
        return [self._replay.finished(own) for own in through]

    def _log_unplaced(self, at: int) -> float:
        """What a history weighs that is placed and recognises nothing, after ``at`` keyframes."""
        carried = self._replay.problem.carried
        followed = None if self._new_ground is None else self._new_ground.at(self._looked_at)
        if followed is None or carried is None:
            return -np.inf
        return followed.log_joints[at - 1 - followed.since] + carried.log_place

    def _ahead(self, own: Progress, first: int) -> Progress | None:
        if own.at > first:
            return own
        try:
            return self._replay.advanced(own, AHEAD)
        except LostComponentError:
            return None


def _likely(group: Sequence[Progress | None], log_least: float) -> list[Progress]:
    """Histories through as many keyframes, without those that are far behind the best, or ``log_least``."""
    found = [own for own in group if own is not None]
    best = max([log_least, *(own.log_joint for own in found)])
    return [own for own in found if own.log_joint >= best - HOPELESS]


def _told(lineage: Lineage) -> object:
    """What a history says of the robot's being carried, and of what it has seen."""
    return tuple((step.association, min(carried_to(step), FIRST_POINT)) for step in lineage[1:])


def _path(steps: Sequence[Step]) -> Array:
    """(T, 3) poses relative to the first of some keyframes, by odometry."""
    poses = [np.zeros(3)]
    for step in steps[1:]:
        poses.append(se2.compose(poses[-1], step.motion.control))
    return np.array(poses)


def _seen(steps: Sequence[Step], path: Array) -> tuple[Array, list[PlanarDetection]]:
    """(N, 2) places of the detections of keyframes along a path (T, 3), and these."""
    pairs = [
        (pose, own)
        for pose, step in zip(path, steps, strict=True)
        for own in step.detections
        if isinstance(own, PlanarDetection)
    ]
    places = [se2.compose(pose, np.append(own.place, 0.0))[:2] for pose, own in pairs]
    return np.reshape(places, (-1, 2)), [own for _, own in pairs]


def _known_well(component: Component) -> tuple[list[int], Array, Array]:
    """Ids of M objects that are likely to exist and whose places are known, these (M, 2), and their sigmas [m]."""
    known = component.objects
    ids = known.ids[known.existence > LEAST_EXISTENCE].tolist()
    spreads = [component.joint_covariance([object_key(n)])[:2, :2] for n in ids]
    sigmas = np.sqrt([0.5 * float(np.trace(own)) for own in spreads])
    is_known = sigmas < LARGEST_SIGMA_M
    well = [n for n, own in zip(ids, is_known.tolist(), strict=True) if own]
    points = component.states([object_key(n) for n in well])[:, :2] if well else np.zeros((0, 2))
    return well, points, sigmas[is_known]
