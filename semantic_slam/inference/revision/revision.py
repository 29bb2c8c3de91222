"""Association revised afterwards: histories in which two objects of a live one are the same, in which one moves, or in
which the robot took one object for another when it came back, and those in which an object is none.

A revised history is replayed from the prior, and so is the one that it comes from: it enters with the ratio of their
P(history, Z_1:k), as if it had been followed all along. Nothing is optimised under it before.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.open_world.mover_proposals import (
    mover_proposals,
    standing_proposals,
    with_mover,
    with_standing,
)
from semantic_slam.inference.pruning import Kinds, shared_out
from semantic_slam.inference.revision.beside import seldom_beside, without_second_boxes
from semantic_slam.inference.revision.dissolving import Dissolving
from semantic_slam.inference.revision.hindsight import HIDES
from semantic_slam.inference.revision.pairs import Pair, apart, merged, near_pairs, relative_distances
from semantic_slam.inference.revision.planar_hindsight import PlanarHindsight
from semantic_slam.inference.revision.replay import Lineage, Replay
from semantic_slam.inference.revision.returns import Returns
from semantic_slam.inference.revision.tried import Group, Tried
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem

HOPELESS_DISTANCE = 8.0
"""Mahalanobis distance between two objects, relative to each other, from which on a replay is spared.

What speaks for a merge against it, a birth less and misses less, is tens of nats at most.
"""
AGAIN = 3
"""Rounds of revision after which what was tried, and seen since, may be tried again."""


class Revision:
    """Proposes and weighs histories in which objects of the best one are the same."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay, registry: ObjectRegistry) -> None:
        self.settings, self._replay, self._registry = settings, replay, registry
        self._tried, self._stood = (Tried(AGAIN * settings.every_keyframes) for _ in range(2))
        self._returns = Returns(settings, replay, registry, AGAIN * settings.every_keyframes)
        self._dissolving = Dissolving(settings.proposals, replay, registry)

    @property
    def is_on(self) -> bool:
        """Whether anything is ever revised."""
        return self.settings.is_on

    def note_keyframe(self) -> None:
        """Give up what replays keep, once there are more keyframes than are ever revised."""
        if len(self._replay.steps) > self.settings.horizon:
            self._replay.forget()

    def is_due(self) -> bool:
        """Whether the newest keyframe is one after which to revise."""
        settings = self.settings
        return self._is_after(settings.every_keyframes) or self._is_after(settings.second_boxes_every_keyframes)

    def _is_after(self, every: int) -> bool:
        """Whether the newest keyframe is the last of ``every`` ones, within the horizon."""
        count = len(self._replay.steps)
        return every > 0 and count % every == 0 and count <= self.settings.horizon

    def revised(
        self, live: Mapping[int, Hypothesis], ids: Sequence[int], objects: ObjectTable, ratio: float
    ) -> dict[int, Hypothesis]:
        """New hypotheses that weigh at least the ``ratio``-th part of the best live one.

        ``objects`` (O, ...) of the best live hypothesis, over the ``ids``. Its weight may stand for near copies that
        were merged into it; a revised one stands for as many, so that it weighs by its ratio to the best one's own.
        """
        best = next(iter(live.values()))
        lineages = []
        if self._is_after(self.settings.every_keyframes):
            lineages += self._changed(best.lineage, ids, objects, ratio)
        if self._is_after(self.settings.second_boxes_every_keyframes):
            lineages += self._without_second_boxes(live, ids, objects)
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
                replayed=own.component,
            )
            for own, gain in gains
            if own.number not in live and gain >= -float(np.log(ratio))
        }

    def _changed(self, lineage: Lineage, ids: Sequence[int], objects: ObjectTable, ratio: float) -> list[Lineage]:
        """Histories in which objects are one, move or stand, or in which returns were to others; in space are none."""
        if self._replay.problem.spaces.name == "spatial":
            return self._without_objects(lineage)
        found = self._proposals(lineage, ids, objects) + self._with_movers(lineage)
        return found + self._splits(lineage, ratio)

    def _proposals(self, lineage: Lineage, ids: Sequence[int], objects: ObjectTable) -> list[Lineage]:
        """All pairs at once first, where there are several, and then one by one, the nearest first."""
        near = [pair for pair in near_pairs(ids, objects, lineage) if self._may_be_one(pair, lineage)]
        pairs = self._not_hopeless(lineage, self._tried.news(near, lineage))[: self.settings.proposals]
        self._tried.note(pairs, len(self._replay.steps))
        together = apart(pairs, lineage)
        chosen = [[pair] for pair in pairs]
        if len(together) > 1:
            chosen.insert(0, together)
        return [merged(lineage, own) for own in chosen]

    def _not_hopeless(self, lineage: Lineage, pairs: Sequence[Pair]) -> list[Pair]:
        """Pairs that may be one by what the history knows of one relative to the other.

        A replay costs a hundred times as much as to ask, and most pairs that are near where the drive has been far from
        its start are surely two.
        """
        (followed,) = self._replay.log_joints([lineage]) if pairs else (None,)
        if followed is None:
            return []
        distances = relative_distances(followed.component, pairs)
        return [pair for pair, distance in zip(pairs, distances, strict=True) if distance <= HOPELESS_DISTANCE]

    def _may_be_one(self, pair: Pair, lineage: Lineage) -> bool:
        """Whether the younger object of a pair is not on the map, and the older not where the robot never was."""
        problem, (older, younger) = self._replay.problem, pair
        on_map = problem.map_ids
        return younger not in on_map and (older not in on_map or problem.is_placed(lineage))

    def _splits(self, lineage: Lineage, ratio: float) -> list[Lineage]:
        """Histories in which a return was of another object."""
        (followed,) = self._replay.log_joints([lineage]) if self.settings.splits else (None,)
        return self._returns.histories(followed, ratio) if followed is not None else []

    def _without_objects(self, lineage: Lineage) -> list[Lineage]:
        """A likelier history in which objects are none; without any where there is none."""
        (followed,) = self._replay.log_joints([lineage])
        found = None if followed is None else self._dissolving.history(followed)
        return [] if found is None else [found]

    def _without_second_boxes(
        self, live: Mapping[int, Hypothesis], ids: Sequence[int], objects: ObjectTable
    ) -> list[Lineage]:
        """Histories, not live ones, in which something that stands beside a thing is none, but second boxes of it."""
        lineage = next(iter(live.values())).lineage
        exist = np.flatnonzero(objects.existence > HIDES).tolist()
        places = {ids[row]: objects.object_poses[row, :3] for row in exist}
        classes = {ids[row]: objects.class_probabilities[row] for row in exist}
        suspects = seldom_beside(places, classes, lineage, self._replay.problem.open_world.second_box_m)
        (followed,) = self._replay.log_joints([lineage]) if suspects else (None,)
        if followed is None:
            return []
        view = PlanarHindsight.of(self._replay, self._registry, followed)
        found = [own for own in without_second_boxes(view, suspects) if self._replay.number_of(own) not in live]
        return found[: self.settings.proposals]

    def _with_movers(self, lineage: Lineage) -> list[Lineage]:
        """Histories in which objects are one that moves, or what moves stands: all at once first, where several do."""
        problem, now = self._replay.problem, len(self._replay.steps)
        (followed,) = self._replay.log_joints([lineage]) if self._replay.may_move else (None,)
        if followed is None or followed.component.tracked is None:
            return []
        first_new = max((entry.object_id for entry in problem.objects), default=-1) + 1
        steps, trail = self._replay.steps, followed.component.tracked.trail
        since = now - AGAIN * self.settings.every_keyframes
        groups = mover_proposals(lineage, steps, trail, first_new, problem.moving, problem.open_world, since)
        alone = standing_proposals(lineage, steps, trail, problem.moving, since)
        return self._each_and_all(lineage, groups, self._tried, with_mover) + self._each_and_all(
            lineage, alone, self._stood, with_standing
        )

    def _each_and_all(
        self, lineage: Lineage, groups: Sequence[Group], tried: Tried, changed: Callable[[Lineage, Group], Lineage]
    ) -> list[Lineage]:
        """The history changed for each of the ``groups`` that were not ``tried``, and for all at once first."""
        chosen = tried.news(groups, lineage)[: self.settings.proposals]
        tried.note(chosen, len(self._replay.steps))
        found = [changed(lineage, group) for group in chosen]
        if len(found) > 1:
            found.insert(0, reduce(changed, chosen, lineage))
        return found


def with_revised(
    live: Mapping[int, Hypothesis],
    found: Mapping[int, Hypothesis],
    places: Mapping[int, Array],
    problem: Problem,
) -> dict[int, Hypothesis]:
    """Live and revised hypotheses, heaviest first, as many as pruning keeps; weights in the live ones' unit.

    What goes for them is a variant, not what pruning keeps for being of another kind. ``places`` (3,) of the live ones'
    robots [m]: a revised history is held to be where the one is that it revises.
    """
    limits = problem.pruning
    every = sorted({**live, **found}.items(), key=lambda item: (-item[1].log_weight, item[0]))
    if limits.place_m <= 0.0:
        return dict(every[: limits.max_hypotheses])
    rows = [places[number] if number in live else places[_revised(own, live)] for number, own in every]
    kinds = Kinds(
        positions=np.array(rows),
        beginnings=np.array([problem.beginning(own.lineage) for _, own in every]),
    ).of(np.arange(len(every)), limits.place_m)
    return dict([every[row] for row in shared_out(kinds, limits.max_hypotheses)])


def _revised(own: Hypothesis, live: Mapping[int, Hypothesis]) -> int:
    """The live one that a hypothesis revises."""
    return next(number for number, other in live.items() if own.revises is other)


def normalised(hypotheses: Mapping[int, Hypothesis]) -> tuple[dict[int, Hypothesis], float]:
    """Hypotheses with weights that sum to one, and the log of what they summed to."""
    weights: Array = np.array([own.log_weight for own in hypotheses.values()])
    total = float(np.logaddexp.reduce(weights))
    return {n: replace(own, log_weight=own.log_weight - total) for n, own in hypotheses.items()}, total
