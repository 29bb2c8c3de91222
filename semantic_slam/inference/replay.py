"""Histories replayed from the prior: what each weighs, log P(history, Z_1:k), and the component it leads to."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.expander import Expander
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component, WeightedComponent
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.growth import certain
from semantic_slam.inference.states.identity import ROOT_ID, hypothesis_id
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.problem import Problem

CHECKPOINT = 10
"""Keyframes from one component that is kept along a replay to the next."""

Lineage = tuple[LineageStep, ...]
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

    def continued(self, lineage: Lineage) -> Lineage:
        """A history with its likeliest continuation through all keyframes since. Raises LostComponentError."""
        known = dict(self._kept)
        own = self._along(lineage, known)
        number, component = own.number, own.component
        expander = Expander(self.problem, self.association)
        for step in self.steps[len(lineage) :]:
            expansion = expander.expand(step, [number], [WeightedComponent(component, 0.0)])
            row = int(np.argmax(expansion.log_psi))
            number, lineage = expansion.ids[row], (*lineage, expansion.steps[row])
            component = certain(expander.grow(step, expansion, [component], [row], in_place=False)[0])
        return lineage

    def _replayed(self, lineage: Lineage, known: dict[int, _Known]) -> Revised | None:
        try:
            return self._along(lineage, known)
        except LostComponentError:
            return None

    def _along(self, lineage: Lineage, known: dict[int, _Known]) -> Revised:
        expander = Expander(self.problem, self.association)
        numbers = self._numbers(lineage)
        begin = max((at for at, number in enumerate(numbers) if number in known), default=0)
        own = self.problem.beginning(lineage)
        at_root = self.association.root(own), self.problem.log_weight_of(own)
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
        numbers = [ROOT_ID + self.problem.beginning(lineage)]
        for step, taken in zip(self.steps, lineage, strict=False):  # a history may end before the newest keyframe
            own = hypothesis_id(numbers[-1], step.stamp_ns, taken.association, taken.class_assignment, taken.mode)
            numbers.append(own)
        return numbers
