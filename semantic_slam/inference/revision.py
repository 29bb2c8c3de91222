"""Association revised afterwards: histories in which two objects of a live one are the same, or in which one moves.

A revised history is replayed from the prior, and so is the one that it comes from: it enters with the ratio of their
P(history, Z_1:k), as if it had been followed all along. Nothing is optimised under it before.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.expander import Expander
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.open_world.mover_proposals import mover_proposals, with_mover
from semantic_slam.inference.smoothing.component import Component, WeightedComponent
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.growth import certain
from semantic_slam.inference.states.identity import ROOT_ID, hypothesis_id
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.problem import Problem

LARGEST_DISTANCE = 4.0
"""Mahalanobis distance between two objects up to which they may be one."""
LARGEST_DISTANCE_M = 3.0
"""Metres between them."""
LEAST_EXISTENCE = 0.1
AGAIN = 3
"""Rounds of revision after which a pair that was tried, and seen since, may be tried again."""
CHECKPOINT = 10
"""Keyframes from one component that is kept along a replay to the next."""

Lineage = tuple[LineageStep, ...]
Pair = tuple[int, int]
_Known = tuple[Component, float]
"""A component, and log P(history, Z_1:k) of the history that leads to it."""


@dataclass(frozen=True)
class Revised:
    """A history that was not followed before."""

    number: int  # its hypothesis id
    parent_id: int
    lineage: Lineage
    log_joint: float  # log P(history, Z_1:k)
    component: Component = field(compare=False)


@dataclass
class Replay:
    """Replays histories, from where they part from what was replayed before."""

    problem: Problem
    association: AssociationStrategy
    steps: list[Step] = field(default_factory=list)  # so far
    _kept: dict[int, _Known] = field(default_factory=dict)  # of the history that was replayed first in the last round

    @property
    def may_move(self) -> bool:
        """Whether there are detections of what may move."""
        moving = self.problem.moving
        return moving.is_on and any(moving.shares(step.labels).any() for step in self.steps)

    def log_joints(self, lineages: Sequence[Lineage]) -> list[Revised | None]:
        """What each weighs; None for one that is impossible. The next round begins where the first of them was."""
        known = dict(self._kept)
        found = [self._replayed(lineage, known) for lineage in lineages]
        self._kept = {number: known[number] for number in self._numbers(lineages[0]) if number in known}
        return found

    def forget(self) -> None:
        """Keep nothing of what was replayed: the next round begins at the prior."""
        self._kept.clear()

    def _replayed(self, lineage: Lineage, known: dict[int, _Known]) -> Revised | None:
        try:
            return self._along(lineage, known)
        except LostComponentError:
            return None

    def _along(self, lineage: Lineage, known: dict[int, _Known]) -> Revised:
        expander = Expander(self.problem, self.association)
        numbers = self._numbers(lineage)
        begin = max((at for at, number in enumerate(numbers) if number in known), default=0)
        kind = self._kind(lineage)
        at_root = self.association.root(kind), self.problem.log_root_weights[kind]
        component, total = known[numbers[begin]] if begin else at_root
        for at in range(begin, len(lineage)):
            step, number, child = self.steps[at], numbers[at], numbers[at + 1]
            expansion = expander.expand(step, [number], [WeightedComponent(component, 0.0)], lineage[at])
            if child not in expansion.ids:
                raise LostComponentError("a lineage names an impossible continuation")
            row = expansion.ids.index(child)
            nobodys = number not in known
            component = certain(expander.grow(step, expansion, [component], [row], in_place=nobodys)[0])
            total += float(expansion.log_psi[row])
            if (at + 1) % CHECKPOINT == 0:
                known[child] = component, total
        return Revised(numbers[-1], numbers[-2], lineage, total, component)

    def _numbers(self, lineage: Lineage) -> list[int]:
        """Ids of the hypotheses along a history, the root's first."""
        numbers = [ROOT_ID + self._kind(lineage)]
        for step, taken in zip(self.steps, lineage, strict=True):
            own = hypothesis_id(numbers[-1], step.stamp_ns, taken.association, taken.class_assignment, taken.mode)
            numbers.append(own)
        return numbers

    def _kind(self, lineage: Lineage) -> int:
        """Which of the noises it begins with."""
        return lineage[0].mode if len(self.problem.noises) > 1 else 0


class Revision:
    """Proposes and weighs histories in which objects of the best one are the same."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay) -> None:
        self.settings, self._replay = settings, replay
        self._tried: dict[tuple[int, ...], int] = {}

    def note(self, step: Step) -> None:
        """Keep a keyframe for later replays, while anything is revised."""
        if self.settings.every_keyframes > 0:
            self._replay.steps.append(step)
        if len(self._replay.steps) > self.settings.horizon:
            self._replay.forget()

    def is_due(self) -> bool:
        """Whether the newest keyframe is one after which to revise."""
        every, count = self.settings.every_keyframes, len(self._replay.steps)
        return every > 0 and count % every == 0 and count <= self.settings.horizon

    def revised(
        self, live: Mapping[int, Hypothesis], ids: Sequence[int], objects: ObjectTable, ratio: float
    ) -> dict[int, Hypothesis]:
        """New hypotheses that weigh at least the ``ratio``-th part of the best live one.

        ``objects`` (O, ...) of the best live hypothesis, over the ``ids``. Its weight may stand for near copies that
        were merged into it; a revised one stands for as many, so that it weighs by its ratio to the best one's own.
        """
        best = next(iter(live.values()))
        lineages = self._proposals(best.lineage, ids, objects) + self._with_movers(best.lineage)
        if not lineages:
            return {}
        followed, *others = self._replay.log_joints([best.lineage, *lineages])
        if followed is None:
            return {}
        gains = [(own, own.log_joint - followed.log_joint) for own in others if own is not None]
        return {
            own.number: Hypothesis(
                owner=best.owner,
                log_weight=best.log_weight + gain,
                parent_id=own.parent_id,
                lineage=own.lineage,
                revises=best,
            )
            for own, gain in gains
            if own.number not in live and gain >= -float(np.log(ratio))
        }

    def _proposals(self, lineage: Lineage, ids: Sequence[int], objects: ObjectTable) -> list[Lineage]:
        """All pairs at once first, where there are several, and then one by one, the nearest first."""
        seen = last_seen(lineage)
        pairs = [pair for pair in near_pairs(ids, objects, lineage) if self._is_news(pair, seen)]
        pairs = pairs[: self.settings.proposals]
        self._tried |= dict.fromkeys(pairs, len(self._replay.steps))
        together = _apart(pairs, lineage)
        chosen = [[pair] for pair in pairs]
        if len(together) > 1:
            chosen.insert(0, together)
        return [merged(lineage, own) for own in chosen]

    def _is_news(self, group: tuple[int, ...], seen: Mapping[int, int]) -> bool:
        """Whether objects were not tried together, or long ago and some of them was ``seen`` (by keyframe) since."""
        tried = self._tried.get(group)
        if tried is None:
            return True
        again = len(self._replay.steps) - tried >= AGAIN * self.settings.every_keyframes
        return again and max(seen.get(number, -1) for number in group) >= tried

    def _with_movers(self, lineage: Lineage) -> list[Lineage]:
        """Histories in which objects are one that moves: all at once first, where there are several."""
        problem, now = self._replay.problem, len(self._replay.steps)
        (followed,) = self._replay.log_joints([lineage]) if self._replay.may_move else (None,)
        if followed is None or followed.component.tracked is None:
            return []
        first_new = max((entry.object_id for entry in problem.objects), default=-1) + 1
        steps, trail = self._replay.steps, followed.component.tracked.trail
        since = now - AGAIN * self.settings.every_keyframes
        seen = last_seen(lineage)
        groups = mover_proposals(lineage, steps, trail, first_new, problem.moving, problem.open_world, since)
        groups = [group for group in groups if self._is_news(group, seen)][: self.settings.proposals]
        self._tried |= dict.fromkeys(groups, now)
        found = [with_mover(lineage, group) for group in groups]
        if len(found) > 1:
            together = lineage
            for group in groups:
                together = with_mover(together, group)
            found.insert(0, together)
        return found


def near_pairs(ids: Sequence[int], objects: ObjectTable, lineage: Lineage) -> list[Pair]:
    """Pairs (older, younger) of objects that may be one by where they are, never seen in one frame; nearest first.

    Those that move are left out: where they are now is not where they were.
    """
    places, spreads = objects.object_poses[:, :2], objects.object_covariances[:, :2, :2]
    moving = objects.moving if objects.moving.size else np.zeros(len(ids))
    alive = [row for row in range(len(ids)) if objects.existence[row] > LEAST_EXISTENCE and moving[row] < 1.0]
    apart = seen_together(lineage)
    found: list[tuple[float, Pair]] = []
    for one, other in combinations(alive, 2):
        pair = min(ids[one], ids[other]), max(ids[one], ids[other])
        offset = places[one] - places[other]
        if pair in apart or not np.hypot(*offset) <= LARGEST_DISTANCE_M:
            continue
        distance = float(np.sqrt(offset @ np.linalg.solve(spreads[one] + spreads[other], offset)))
        if distance <= LARGEST_DISTANCE:
            found.append((distance, pair))
    return [pair for _, pair in sorted(found)]


def last_seen(lineage: Lineage) -> dict[int, int]:
    """Object -> the keyframe at which it was detected last."""
    return {number: keyframe for keyframe, step in enumerate(lineage) for number in step.association}


def seen_together(lineage: Lineage) -> set[Pair]:
    """Pairs of objects that some frame shows both of."""
    return {pair for step in lineage for pair in combinations(sorted(n for n in step.association if n >= 0), 2)}


def merged(lineage: Lineage, pairs: Sequence[Pair]) -> Lineage:
    """The history in which the younger object of each pair is the older one."""
    names = {younger: older for older, younger in pairs}
    return tuple(
        replace(step, association=tuple(names.get(number, number) for number in step.association)) for step in lineage
    )


def _apart(pairs: Sequence[Pair], lineage: Lineage) -> list[Pair]:
    """Pairs without an object in common, of which no frame would show one object twice."""
    chosen: list[Pair] = []
    taken: set[int] = set()
    for pair in pairs:
        if not taken & set(pair):
            chosen.append(pair)
            taken |= set(pair)
    return chosen


def with_revised(live: Mapping[int, Hypothesis], found: Mapping[int, Hypothesis], limit: int) -> dict[int, Hypothesis]:
    """Live and revised hypotheses, heaviest first, at most ``limit``; weights in the live ones' unit."""
    every = sorted({**live, **found}.items(), key=lambda item: (-item[1].log_weight, item[0]))
    return dict(every[:limit])


def log_mass(hypotheses: Mapping[int, Hypothesis]) -> float:
    """Log of the sum of their weights."""
    weights: Array = np.array([own.log_weight for own in hypotheses.values()])
    return float(np.logaddexp.reduce(weights))
