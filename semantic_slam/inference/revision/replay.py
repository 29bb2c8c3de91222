"""Histories replayed from the prior: what each weighs, log P(history, Z_1:k), and the component it leads to."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.expander import Expander, Expansion
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component, WeightedComponent
from semantic_slam.inference.smoothing.errors import LostComponentError, UnknownObjectsError
from semantic_slam.inference.smoothing.growth import certain
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import LineageStep, next_id
from semantic_slam.inference.world.carried import NOWHERE
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem

CHECKPOINT = 10
"""Keyframes from one component that is kept along a replay to the next."""
CLOSE = 4
"""That many of them at the end of a replay stay as close; before, as far apart as twice as long ago asks for."""

Lineage = tuple[LineageStep, ...]


@dataclass(frozen=True)
class Progress:
    """A history replayed so far; beyond the steps that it names, its likeliest continuation is followed."""

    lineage: Lineage
    at: int  # keyframes replayed
    number: int  # hypothesis id after these
    component: Component
    log_joint: float  # log P(history, Z_1:at)
    expected_births: float  # in all of them


@dataclass(frozen=True)
class Revised:
    """A history that was not followed before."""

    number: int  # its hypothesis id
    parent_id: int
    lineage: Lineage
    log_joint: float  # log P(history, Z_1:k)
    component: Component = field(compare=False)
    expected_births: float = field(default=0.0, compare=False)


@dataclass
class Replay:
    """Replays histories, from where they part from what was replayed before."""

    problem: Problem
    association: AssociationStrategy
    steps: list[Step] = field(default_factory=list)  # so far
    registry: ObjectRegistry | None = None  # what a history names and has given up begins anew by it; None: impossible
    _kept: dict[int, Progress] = field(default_factory=dict)  # of the history that was replayed first in the last round
    _beside: dict[int, Progress] = field(default_factory=dict)  # of the others: one may be followed from now on

    @property
    def may_move(self) -> bool:
        """Whether there are detections of what may move."""
        moving = self.problem.moving
        return moving.is_on and any(moving.shares(step.labels).any() for step in self.steps)

    def log_joints(self, lineages: Sequence[Lineage]) -> list[Revised | None]:
        """What each weighs; None for one that is impossible. The next round begins where these were."""
        first, *others = lineages
        known, along = self._kept | self._beside, set(self._numbers(first))
        found = [self._replayed(first, known)]
        self._kept = {number: own for number, own in known.items() if number in along and stays(own.at, len(first))}
        again = {number for lineage in others for number in self._numbers(lineage)}  # tried a moment ago, maybe
        known = self._kept | {number: own for number, own in known.items() if number in again}
        found += [self._replayed(lineage, known) for lineage in others]
        self._beside = {
            number: own for number, own in known.items() if number not in self._kept and stays(own.at, len(first))
        }
        return found

    def forget(self) -> None:
        """Keep nothing of what was replayed: the next round begins at the prior."""
        self._kept.clear()
        self._beside.clear()

    def _replayed(self, lineage: Lineage, kept: dict[int, Progress] | None = None) -> Revised | None:
        try:
            return self.finished(self._to(lineage, kept))
        except LostComponentError:
            return None

    def _to(self, lineage: Lineage, kept: dict[int, Progress] | None = None) -> Progress:
        """A history up to where it ends, and along it what is to be ``kept``; None: nothing."""
        known, numbers = self._kept if kept is None else kept, self._numbers(lineage)
        begin = max((at for at, number in enumerate(numbers) if number in known), default=0)
        own = replace(known[numbers[begin]], lineage=lineage) if begin else self.begun(lineage)
        while own.at < len(lineage):
            own = self.advanced(own, 1, in_place=own.number not in known)
            if kept is not None and own.at % CHECKPOINT == 0:
                kept[own.number] = own
        return own

    def begun(self, lineage: Lineage) -> Progress:
        """A history before the first keyframe."""
        beginning = self.problem.beginning(lineage)
        root, log_weight = self.association.root(beginning), self.problem.log_weight_of(beginning)
        return Progress(lineage, 0, ROOT_ID + beginning, root, log_weight, 0.0)

    def advanced(self, own: Progress, count: int, *, in_place: bool = True) -> Progress:
        """A history after at most ``count`` keyframes more. Raises LostComponentError where it is impossible.

        ``in_place``: nobody needs it again as it was.
        """
        for step in self.steps[own.at : own.at + count]:
            named = own.lineage[own.at] if own.at < len(own.lineage) else None
            try:
                own = self._next(own, step, named, in_place=in_place)
            except UnknownObjectsError as fault:
                if self.registry is None:
                    raise
                own = begun_anew(own, fault.object_ids, self.registry.first_new_id(own.at))
                own = self._next(own, step, own.lineage[own.at], in_place=in_place)
        return own

    def before(self, lineage: Lineage, keyframe: int) -> Progress | None:
        """A history before a keyframe, which nobody may advance in place; None where it is impossible."""
        try:
            return self._to(lineage[:keyframe])
        except LostComponentError:
            return None

    def carried(self, own: Progress, point: int) -> Progress:
        """A history with the likeliest keyframe more, before which the robot was carried to a point.

        Raises LostComponentError where it is impossible.
        """
        return self._next(own, self.steps[own.at], None, point, in_place=False)

    def _next(
        self, own: Progress, step: Step, named: LineageStep | None, carried: int = NOWHERE, *, in_place: bool
    ) -> Progress:
        expander, held = Expander(self.problem, self.association), WeightedComponent(own.component, 0.0)
        expansion = expander.expand(step, [own.number], [held], named, carried)
        row = int(np.argmax(expansion.log_psi)) if named is None else self._row(own, step, expansion)
        (grown,) = expander.grow(expansion, [row], in_place=in_place)
        return Progress(
            lineage=(*own.lineage, expansion.steps[row]) if named is None else own.lineage,
            at=own.at + 1,
            number=expansion.ids[row],
            component=certain(grown),
            log_joint=own.log_joint + float(expansion.log_psi[row]),
            expected_births=own.expected_births + expansion.keyframe.expected_births,
        )

    def continued(self, lineage: Lineage) -> Lineage | None:
        """A history with its likeliest continuation through all keyframes since; None where it is impossible."""
        try:
            return self.advanced(self._to(lineage), len(self.steps), in_place=False).lineage
        except LostComponentError:
            return None

    def finished(self, own: Progress) -> Revised:
        """What a history weighs that was replayed through all keyframes so far."""
        numbers = self._numbers(own.lineage)
        return Revised(own.number, numbers[-2], own.lineage, own.log_joint, own.component, own.expected_births)

    def number_of(self, lineage: Lineage) -> int:
        """Id of the hypothesis that has a history."""
        return self._numbers(lineage)[-1]

    def _row(self, own: Progress, step: Step, expansion: Expansion) -> int:
        """Which candidate a history names. Raises LostComponentError where there is none."""
        named = own.lineage[own.at]
        child = next_id(own.number, step.stamp_ns, named)
        if child not in expansion.ids:
            raise LostComponentError("a lineage names an impossible continuation")
        return expansion.ids.index(child)

    def _numbers(self, lineage: Lineage) -> list[int]:
        """Ids of the hypotheses along a history, the root's first."""
        numbers = [ROOT_ID + self.problem.beginning(lineage)]
        for step, taken in zip(self.steps, lineage, strict=False):
            numbers.append(next_id(numbers[-1], step.stamp_ns, taken))
        return numbers


def begun_anew(own: Progress, object_ids: Collection[int], first_new_id: int) -> Progress:
    """A history in which objects that it names next begin by the detection that names them, and were others before."""
    born = {n: first_new_id + number for number, n in enumerate(own.lineage[own.at].association)}
    anew = {n: born[n] for n in object_ids}
    rest = (
        replace(step, association=tuple(anew.get(n, n) for n in step.association)) for step in own.lineage[own.at :]
    )
    return replace(own, lineage=(*own.lineage[: own.at], *rest))


def stays(at: int, now: int) -> bool:
    """Whether a component after ``at`` keyframes is kept when there are ``now``: a logarithmic number of them is.

    A history that parts from the one they are along is then replayed from at most twice as long ago.
    """
    apart = CHECKPOINT
    while now - at > CLOSE * apart:
        apart *= 2
    return at % apart == 0
