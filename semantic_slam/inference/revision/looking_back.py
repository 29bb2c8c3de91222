"""One look back from a live history: alternatives that may be likelier are replayed and enter by their weight."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import reduce
from itertools import chain

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.open_world.moving.mover_proposals import (
    mover_proposals,
    standing_proposals,
    with_mover,
    with_standing,
)
from semantic_slam.inference.revision.catching_up import CatchingUp, Level
from semantic_slam.inference.revision.hindsight.beside import seldom_beside, without_second_boxes
from semantic_slam.inference.revision.hindsight.hindsight import HIDES
from semantic_slam.inference.revision.hindsight.planar import PlanarHindsight
from semantic_slam.inference.revision.hindsight.proposals import Proposals
from semantic_slam.inference.revision.pairs import Pair, apart, merged, near_pairs, relative_distances
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.revision.returns.returns import Returns
from semantic_slam.inference.revision.tried import Group, Tried
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry

HOPELESS_DISTANCE = 8.0
"""Mahalanobis distance of two objects' relative position beyond which a merge of them is not replayed.  A merge gains
at most tens of nats, by one birth and some misses fewer."""
AGAIN = 3
"""Rounds of revision after which a proposal that was tried, and whose objects were seen since, may be tried again."""


class Kind(Enum):
    """Kinds of alternatives that a look may search for."""

    OTHERWISE = auto()  # merges, moving/standing, other loop closures; in space: objects that do not exist
    SECOND_BOXES = auto()  # in the plane: objects that are only duplicate boxes of things beside them


@dataclass(frozen=True)
class Present:
    """The state after the newest keyframe."""

    live: Mapping[int, Hypothesis]  # heaviest first
    ids: Sequence[int]  # O
    objects: Mapping[int, ObjectTable]  # (O, ...) table of each live hypothesis
    log_evidence: float  # normaliser that live weights are relative to


class LookingBack:
    """Proposes and weighs alternatives to one history, which is itself replayed first."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay, registry: ObjectRegistry) -> None:
        self._settings, self._replay, self._registry = settings, replay, registry
        self._tried, self._stood = (Tried(AGAIN * settings.every_keyframes) for _ in range(2))
        self._returns = Returns(settings, replay, registry, AGAIN * settings.every_keyframes)
        self._proposing = Proposals(settings.proposals, replay, registry)
        self._catching_up = CatchingUp(replay)
        self._ahead: Iterator[Level] | None = None  # of replays that have gone on through the newest keyframe already
        self._subject: Lineage = ()  # the history that alternatives are sought for
        self._kinds: Set[Kind] = frozenset()  # kinds of alternatives sought
        self._log_surplus = 0.0  # log ratio of its weight with merged near copies to its own

    @property
    def is_idle(self) -> bool:
        """Whether no proposal of an earlier look is still being replayed."""
        return self._catching_up.is_idle and self._ahead is None

    def go_on(self) -> None:
        """Replay waiting histories until one has caught up with the newest keyframe, or enough is done for now."""
        levels = self._catching_up.go_on()
        first = next(levels, None)
        self._ahead = iter(()) if first is None else chain((first,), levels)

    def begin(self, present: Present, kinds: Set[Kind]) -> None:
        """Begin a look at the best history, unless only duplicate boxes are due and nothing is suspected to be one."""
        number, subject = next(iter(present.live.items()))
        if Kind.OTHERWISE in kinds or self._suspects(present, number):
            self._subject, self._kinds = subject.lineage, kinds
            self._catching_up.add([self._subject])

    def give_up(self) -> None:
        """Stop revising: drop checkpoints and pending proposals."""
        self._replay.forget()
        self._catching_up.give_up()

    def found(self, present: Present) -> dict[int, Hypothesis]:
        """New hypotheses whose weight relative to the one that each revises is above the pruning ratio.

        The weight of the revised history may include near copies merged into it; a revision is scaled by the same
        surplus.
        """
        live, found = present.live, dict[int, Hypothesis]()
        levels, self._ahead = self._ahead or self._catching_up.go_on(), None
        for asked, own in levels:
            if asked is self._subject:
                self._look(own, present)
                continue
            heir = self._heir(live)
            log_weight = -np.inf if own is None else own.log_joint + self._log_surplus - present.log_evidence
            if self._is_likely(asked, log_weight - heir.log_weight) and own is not None:
                found[own.number] = own.entering(heir.owner, heir, log_weight, self._log_surplus)
        return {number: own for number, own in found.items() if number not in live}

    def _heir(self, live: Mapping[int, Hypothesis]) -> Hypothesis:
        """The likeliest live continuation of the history under look, or else the likeliest live hypothesis."""
        length, every = len(self._subject), list(live.values())
        return next((own for own in every if own.lineage[:length] == self._subject), every[0])

    def _is_likely(self, asked: Lineage, gain: float) -> bool:
        """Whether a revision enters, by its ``gain`` [nats] over what it revises; in space only if it is positive."""
        if not self._is_in_space:
            return gain >= -float(np.log(self._replay.problem.pruning.ratio))
        if gain <= 0.0:
            self._proposing.note(asked)
            return False
        self._catching_up.give_up()
        return True

    @property
    def _is_in_space(self) -> bool:
        return self._replay.problem.spaces.name == "spatial"

    def _look(self, followed: Revised | None, present: Present) -> None:
        """Queue alternatives to a history that has caught up, if it is still live."""
        if followed is None or followed.number not in present.live:
            return
        self._subject = followed.lineage
        self._replay.keep_along(followed.lineage)
        log_weight = present.live[followed.number].log_weight
        self._log_surplus = log_weight + present.log_evidence - followed.log_joint
        if self._is_in_space:
            pairs = self._near_pairs(followed, present.ids, present.objects[followed.number])
            for history, gains in self._proposing.histories(followed, pairs).items():
                self._catching_up.add([history], followed.log_joints, gains)
            return
        found: list[Lineage] = []
        if Kind.OTHERWISE in self._kinds:
            found += self._proposals(followed, present.ids, present.objects[followed.number])
            found += self._with_movers(followed)
            found += self._returns.histories(followed, self._replay.problem.pruning.ratio)
        if Kind.SECOND_BOXES in self._kinds:
            found += self._without_second_boxes(followed, present)
        self._catching_up.add(found, followed.log_joints)

    def _without_second_boxes(self, followed: Revised, present: Present) -> list[Lineage]:
        """Histories, not live ones, in which an object is removed as duplicate boxes of the thing beside it."""
        suspects = self._suspects(present, followed.number)
        if not suspects:
            return []
        view = PlanarHindsight.of(self._replay, self._registry, followed)
        found = without_second_boxes(view, suspects)
        return [own for own in found if self._replay.number_of(own) not in present.live][: self._settings.proposals]

    def _suspects(self, present: Present, number: int) -> Collection[int]:
        """Objects of a live history that may be duplicate boxes of what stands beside them."""
        ids, objects = present.ids, present.objects[number]
        exist = np.flatnonzero(objects.existence > HIDES).tolist()
        places = {ids[row]: objects.object_poses[row, :3] for row in exist}
        classes = {ids[row]: objects.class_probabilities[row] for row in exist}
        size = self._replay.problem.open_world.second_box_m
        return seldom_beside(places, classes, present.live[number].lineage, size)

    def _proposals(self, followed: Revised, ids: Sequence[int], objects: ObjectTable) -> list[Lineage]:
        """Histories with pairs of objects merged: first all pairs at once if several, then each, nearest first."""
        lineage = followed.lineage
        near = self._near_pairs(followed, ids, objects)
        pairs = _not_hopeless(followed.component, self._tried.news(near, lineage))[: self._settings.proposals]
        self._tried.note(pairs, len(self._replay.steps))
        together = apart(pairs)
        chosen = [[pair] for pair in pairs]
        if len(together) > 1:
            chosen.insert(0, together)
        return [merged(lineage, own) for own in chosen]

    def _near_pairs(self, followed: Revised, ids: Sequence[int], objects: ObjectTable) -> list[Pair]:
        """Pairs of objects that may be one, nearest first."""
        limits = (3, HOPELESS_DISTANCE) if self._is_in_space else (2,)
        pairs = near_pairs(ids, objects, followed.lineage, *limits)
        return [pair for pair in pairs if self._may_be_one(pair, followed.lineage)]

    def _may_be_one(self, pair: Pair, lineage: Lineage) -> bool:
        """Whether a pair may be merged: the younger is not on the map; if the older is, the robot is localised."""
        problem, (older, younger) = self._replay.problem, pair
        on_map = problem.map_ids
        return younger not in on_map and (older not in on_map or problem.is_placed(lineage))

    def _with_movers(self, followed: Revised) -> list[Lineage]:
        """Histories in which objects are one moving object, or a moving one stands: all at once first, then each."""
        problem, now, lineage = self._replay.problem, len(self._replay.steps), followed.lineage
        movers = followed.component.movers
        if not self._replay.may_move or followed.component.tracked is None or movers is None:
            return []
        first_new = max((entry.object_id for entry in problem.objects), default=-1) + 1
        steps = [replace(own, detections=followed.component.sensed(own.detections)) for own in self._replay.steps]
        trail, rates = followed.component.tracked.trail, followed.component.objects.rates
        since = max(now - AGAIN * self._settings.every_keyframes, 0)
        errors = followed.component.tracked.sensor
        sensor = None if errors is None else errors[:, 0]
        density = float(rates.average(rates.birth_density))
        groups = mover_proposals(lineage, steps, trail, first_new, problem.moving, density, since, sensor)
        alone = standing_proposals(lineage, movers, since)
        return self._each_and_all(lineage, groups, self._tried, with_mover) + self._each_and_all(
            lineage, alone, self._stood, with_standing
        )

    def _each_and_all(
        self, lineage: Lineage, groups: Sequence[Group], tried: Tried, changed: Callable[[Lineage, Group], Lineage]
    ) -> list[Lineage]:
        """The history changed for each of the ``groups`` not ``tried`` yet, and first for all at once where several."""
        chosen = tried.news(groups, lineage)[: self._settings.proposals]
        tried.note(chosen, len(self._replay.steps))
        found = [changed(lineage, group) for group in chosen]
        if len(found) > 1:
            found.insert(0, reduce(changed, chosen, lineage))
        return found


def _not_hopeless(component: Component, pairs: Sequence[Pair]) -> list[Pair]:
    """Pairs that may be one object, given the covariance of their relative position.

    A replay costs a hundred times as much as this test, and most pairs that are near each other where the drive has
    been far from its start are surely two objects.
    """
    if not pairs:
        return []
    distances = relative_distances(component, pairs)
    return [pair for pair, distance in zip(pairs, distances, strict=True) if distance <= HOPELESS_DISTANCE]
