"""A robot that was carried in mid-drive: histories in which it was, from a keyframe that the belief did not expect on.

Where a keyframe was likelier under the reference model than under the belief, the robot may have been carried just
before. From then on its detections, placed by odometry alone, are fitted to what it had mapped until then. The
likeliest poses are replayed, a few keyframes at a time, and enter with P(history, Z_1:k), as those of a lost robot do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.models.planar_detection import PlanarDetection
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.relocation.alike import log_alike
from semantic_slam.inference.relocation.likelihood_field import LikelihoodField
from semantic_slam.inference.revision.replay import Lineage, Progress, Replay, Revised
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.world.carried import NOWHERE, carried_to
from semantic_slam.inference.world.objects import ObjectRegistry

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


class Recovery:
    """Proposes and weighs histories in which the robot was carried."""

    def __init__(self, replay: Replay, registry: ObjectRegistry) -> None:
        self._replay, self._registry = replay, registry
        self._num_noted = 0  # keyframes
        self._misfit: _Suspect | None = None  # that goes on
        self._suspects: dict[int, _Suspect] = {}  # by keyframe before which the robot may have been carried
        self._waiting: list[Progress] = []
        self._looked_at: _Suspect | None = None  # whose places wait

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

    def found(self, live: Mapping[int, Hypothesis], ratio: float) -> dict[int, Hypothesis]:
        """New hypotheses that weigh at least the ``ratio``-th part of the best live one."""
        if not self.is_on:
            return {}
        best = next(iter(live.values()))
        due = self._due()
        if due is not None:
            self._look(due, live)
        caught_up = self._caught_up()
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

    def _due(self) -> int | None:
        """The least expected of the keyframes that are to be looked at now, if it is less so than what waits."""
        now = len(self._replay.steps)
        self._suspects = {at: own for at, own in self._suspects.items() if own.looks < len(LOOKS)}
        due = {at: own for at, own in self._suspects.items() if now - at > LOOKS[own.looks]}
        at = max(due, key=lambda at: due[at].log_ratio, default=None)
        waits = self._looked_at if self._waiting else None
        if at is None or (waits is not None and due[at].log_ratio <= waits.log_ratio):
            return None
        return at

    def _look(self, since: int, live: Mapping[int, Hypothesis]) -> None:
        """Begin to replay histories in which the robot was carried just before a keyframe."""
        now, carried = len(self._replay.steps), self._replay.problem.carried
        assert carried is not None
        self._looked_at, self._waiting = self._suspects[since], []
        self._looked_at.looks = sum(now - since > apart for apart in LOOKS)
        best, lately = next(iter(live.values())), slice(max(since - SOON, 1), since)
        lineages = [own.lineage for own in live.values() if not any(map(carried_to, own.lineage[lately]))]
        lineage = [*lineages, best.lineage][0]
        before = self._replay.before(lineage, since)
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
            self._waiting = _likely([self._ahead(own, first) for own in self._waiting])
        if not self._waiting or self._waiting[0].at < now:
            return []
        through, self._waiting = self._waiting, []
        return [self._replay.finished(own) for own in through]

    def _ahead(self, own: Progress, first: int) -> Progress | None:
        if own.at > first:
            return own
        try:
            return self._replay.advanced(own, AHEAD)
        except LostComponentError:
            return None


def _likely(group: Sequence[Progress | None]) -> list[Progress]:
    """Histories through as many keyframes, without those that are far behind the best."""
    found = [own for own in group if own is not None]
    best = max((own.log_joint for own in found), default=0.0)
    return [own for own in found if own.log_joint >= best - HOPELESS]


def _told(lineage: Lineage) -> object:
    """What a history says of the robot's being carried, and of what it has seen."""
    return tuple((step.association, carried_to(step) > NOWHERE) for step in lineage[1:])


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
