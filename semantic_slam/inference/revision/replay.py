"""Replay of association histories from the prior: log P(history, Z_1:k) and the component that each leads to."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.expander import Expander, Expansion
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component, WeightedComponent
from semantic_slam.inference.smoothing.errors import LostComponentError, UnknownObjectsError
from semantic_slam.inference.smoothing.growth import certain
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import Lineage, LineageStep, next_id
from semantic_slam.inference.world.carried import NOWHERE, new_grounds
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem

CHECKPOINT = 10
"""Keyframes between components that are kept along a replay (checkpoints)."""
REACH = 2
"""Horizons (``history.horizon_keyframes``) that a replay may begin ago."""
CLOSE = 4
"""Number of checkpoints at full density at the end of a replay; spacing doubles as age doubles before that."""


@dataclass(frozen=True)
class Progress:
    """A history replayed up to some keyframe; beyond the steps it names, its likeliest continuation is followed."""

    lineage: Lineage
    at: int  # number of keyframes replayed
    number: int  # hypothesis id after ``at`` keyframes
    component: Component
    log_joints: tuple[float, ...]  # log P(history, Z_1:i) for i = 0 .. at
    expected_births: float  # summed over these keyframes
    replicates: Array  # (B,) bootstrap replicates of the weight, see ``Bagging``

    @property
    def log_joint(self) -> float:
        """log P(history, Z_1:at)."""
        return self.log_joints[-1]


@dataclass(frozen=True)
class Revised:
    """A history replayed through all keyframes, which was not followed before."""

    number: int  # its hypothesis id
    parent_id: int
    lineage: Lineage
    log_joints: tuple[float, ...]  # log P(history, Z_1:i) for i = 0 .. k
    component: Component = field(compare=False)
    expected_births: float = field(default=0.0, compare=False)
    replicates: Array = field(default_factory=lambda: np.zeros(0), compare=False)  # (B,)

    @property
    def log_joint(self) -> float:
        """log P(history, Z_1:k)."""
        return self.log_joints[-1]

    def entering(self, owner: int, revises: Hypothesis, log_weight: float, log_surplus: float) -> Hypothesis:
        """The history as a hypothesis that enters with ``log_weight`` and ``revises`` a live one.

        ``log_surplus``: log ratio of the revised one's weight with merged near copies to its own.
        """
        return Hypothesis(
            owner=owner,
            log_weight=log_weight,
            parent_id=self.parent_id,
            lineage=self.lineage,
            grounds=new_grounds(self.lineage),
            revises=revises,
            replayed=self.component,
            replicates=self.replicates + log_surplus,
        )


@dataclass
class Replay:
    """Replays histories, starting from the latest checkpoint that they share with what was replayed before."""

    problem: Problem
    association: AssociationStrategy
    steps: KeptSteps = field(default_factory=KeptSteps)  # every keyframe so far
    registry: ObjectRegistry | None = None  # gives new ids to dropped objects that a history names; None: impossible
    _kept: dict[int, Progress] = field(default_factory=dict)  # checkpoints of the history followed last
    _beside: dict[int, Progress] = field(default_factory=dict)  # checkpoints of other histories replayed since
    _numbered: tuple[Lineage, list[int]] = ((), [])  # the history numbered last, and its ids: the next one shares most

    @property
    def may_move(self) -> bool:
        """Whether any detection so far has a label whose objects may move."""
        moving = self.problem.moving
        return moving.is_on and any(moving.shares(step.labels).any() for step in self.steps)

    def followed(self, lineage: Lineage) -> Revised | None:
        """The weight of a history, continued by its likeliest steps where it ends early; None: it is impossible.

        Its checkpoints are kept, and those of other histories that it does not share are dropped.
        """
        try:
            own = self.resumed(lineage)
            while own.at < len(self.steps):
                own = self.further(own)
        except LostComponentError:
            return None
        self._beside[own.number] = own
        self.keep_along(own.lineage)
        return self.finished(own)

    def keep_along(self, lineage: Lineage) -> None:
        """Keep the checkpoints along ``lineage`` alone, and its present state, from which it is followed next time."""
        along = set(self._numbers(lineage))
        self._kept = {number: own for number, own in (self._kept | self._beside).items() if self._stays(own, along)}
        self._beside.clear()

    def _stays(self, own: Progress, along: Collection[int]) -> bool:
        """Whether a checkpoint is kept, if only those ``along`` a history are."""
        now = len(self.steps)
        return own.number in along and own.at >= self.reach and (stays(own.at, now) or own.at >= now - 1)

    def forget(self) -> None:
        """Drop all checkpoints: the next replay begins at the prior."""
        self._kept.clear()
        self._beside.clear()

    def begun(self, lineage: Lineage) -> Progress:
        """A history before the first keyframe."""
        root_number = self.problem.root_number(lineage)
        root, log_weight = self.association.root(root_number), self.problem.log_weight_of(root_number)
        return Progress(
            lineage, 0, ROOT_ID + root_number, root, (log_weight,), 0.0, self.problem.bagging.begun(log_weight)
        )

    def advanced(self, own: Progress, count: int, *, in_place: bool = True) -> Progress:
        """A history after at most ``count`` more keyframes. Raises LostComponentError where it is impossible.

        ``in_place``: its smoother may be consumed, as nobody needs the former state.
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

    def resumed(self, lineage: Lineage) -> Progress:
        """A history at the latest checkpoint along it, or else before the first keyframe.

        Raises LostComponentError where that is before the reach of replays.
        """
        known = self._kept | self._beside
        number = next((number for number in reversed(self._numbers(lineage)) if number in known), None)
        own = self.begun(lineage) if number is None else replace(known[number], lineage=lineage)
        if own.at < self.reach:
            raise LostComponentError("a history parted from the others too long ago")
        return own

    @property
    def reach(self) -> int:
        """Least number of keyframes after which a replay may begin: above 0 where old poses are marginalised."""
        horizon = self.problem.history.horizon_keyframes
        return max(len(self.steps) - REACH * horizon, 0) if horizon else 0

    def further(self, own: Progress) -> Progress:
        """A history after one more keyframe; checkpoints are kept, as it may be followed from now on.

        Raises LostComponentError where it is impossible.
        """
        own = self._stepped(own)
        self._keep(own)
        return own

    def _stepped(self, own: Progress) -> Progress:
        """A history after one more keyframe; its former state is consumed unless that is a checkpoint."""
        return self.advanced(own, 1, in_place=not self._is_kept(own))

    def branched(self, front: Sequence[Progress], most: int) -> list[Progress]:
        """The ``most`` likeliest continuations of some histories through one keyframe, likeliest first.

        Continuations below the pruning ratio relative to the best are dropped. All histories must have come equally
        far, and none may name the next step. Checkpoints are kept as by :meth:`further`. Raises LostComponentError
        where there is no continuation.
        """
        expander, numbers = Expander(self.problem, self.association), [own.number for own in front]
        held = [WeightedComponent(own.component, 0.0) for own in front]
        expansion = expander.expand(self.steps[front[0].at], numbers, held)
        origins = np.array([numbers.index(own) for own in expansion.parents.ids])[expansion.assignments.parents]
        log_joints = np.array([own.log_joint for own in front])[origins] + expansion.log_psi
        ranked = np.argsort(-log_joints, kind="stable")[:most]
        least = log_joints[ranked[0]] - np.log(self.problem.pruning.ratio)
        rows = ranked[log_joints[ranked] >= least].tolist()
        grown = expander.grow(expansion, rows, in_place=not any(map(self._is_kept, front)))
        found = [
            self._continued(front[origins[row]], expansion, row, own)
            for row, own in zip(rows, grown, strict=True)
            if isinstance(own, Component)
        ]
        if not found:
            raise LostComponentError("no continuation of a history can be solved")
        for own in found:
            self._keep(own)
        return found

    def before(self, lineage: Lineage, keyframe: int) -> Progress | None:
        """A history just before a keyframe, which becomes a checkpoint; None where it is impossible."""
        try:
            own = self.resumed(lineage[:keyframe])
            while own.at < keyframe:
                own = self._stepped(own)
        except LostComponentError:
            return None
        self._beside[own.number] = own
        return own

    def _keep(self, own: Progress) -> None:
        if own.at % CHECKPOINT == 0 and stays(own.at, len(self.steps)):
            self._beside[own.number] = own

    def _is_kept(self, own: Progress) -> bool:
        return own.number in self._kept or own.number in self._beside

    def carried(self, own: Progress, point: int) -> Progress:
        """A history with its likeliest next keyframe, before which the robot was carried (kidnapped) to ``point``.

        ``point`` is one of the lattice of displacements, or new ground. Raises LostComponentError where it is
        impossible.
        """
        return self._next(own, self.steps[own.at], None, point, in_place=False)

    def _next(
        self, own: Progress, step: Step, named: LineageStep | None, carried: int = NOWHERE, *, in_place: bool
    ) -> Progress:
        expander, held = Expander(self.problem, self.association), WeightedComponent(own.component, 0.0)
        expansion = expander.expand(step, [own.number], [held], named, carried)
        row = int(np.argmax(expansion.log_psi)) if named is None else self._row(own, step, expansion)
        (grown,) = expander.grow(expansion, [row], in_place=in_place)
        return self._continued(own, expansion, row, certain(grown))

    def _continued(self, own: Progress, expansion: Expansion, row: int, component: Component) -> Progress:
        """A history with one more candidate, which its lineage names already or is extended by."""
        parent, log_psi = int(expansion.assignments.parents[row]), float(expansion.log_psi[row])
        return Progress(
            lineage=own.lineage if own.at < len(own.lineage) else (*own.lineage, expansion.steps[row]),
            at=own.at + 1,
            number=expansion.ids[row],
            component=component,
            log_joints=(*own.log_joints, own.log_joint + log_psi),
            expected_births=own.expected_births + float(expansion.keyframe.expected_births[parent]),
            replicates=self.problem.bagging.grown(own.replicates, own.at, log_psi),
        )

    def finished(self, own: Progress) -> Revised:
        """The result of a history that was replayed through all keyframes so far."""
        numbers = self._numbers(own.lineage)
        return Revised(
            own.number, numbers[-2], own.lineage, own.log_joints, own.component, own.expected_births, own.replicates
        )

    def number_of(self, lineage: Lineage) -> int:
        """Id of the hypothesis that has this history."""
        return self._numbers(lineage)[-1]

    def _row(self, own: Progress, step: Step, expansion: Expansion) -> int:
        """Row of the candidate that the history names. Raises LostComponentError where there is none."""
        named = own.lineage[own.at]
        child = next_id(own.number, step.stamp_ns, named)
        if child not in expansion.ids:
            raise LostComponentError("a lineage names an impossible continuation")
        return expansion.ids.index(child)

    def _numbers(self, lineage: Lineage) -> list[int]:
        """Ids of the hypotheses along a history, the root's first."""
        known, ids = self._numbered
        pairs = enumerate(zip(known, lineage, strict=False))
        shared = next((at for at, (one, other) in pairs if one is not other), min(len(known), len(lineage)))
        numbers = ids[: shared + 1] if shared else [ROOT_ID + self.problem.root_number(lineage)]
        for stamp_ns, taken in zip(self.steps.stamps_ns[shared:], lineage[shared:], strict=False):
            numbers.append(next_id(numbers[-1], stamp_ns, taken))
        self._numbered = lineage, numbers
        return numbers


def begun_anew(own: Progress, object_ids: Collection[int], first_new_id: int) -> Progress:
    """A history in which dropped objects start anew, under new ids, with the next detection that names them."""
    born = {n: first_new_id + number for number, n in enumerate(own.lineage[own.at].association)}
    anew = {n: born[n] for n in object_ids}
    rest = (
        replace(step, association=tuple(anew.get(n, n) for n in step.association)) for step in own.lineage[own.at :]
    )
    return replace(own, lineage=(*own.lineage[: own.at], *rest))


def stays(at: int, now: int) -> bool:
    """Whether the checkpoint after ``at`` keyframes is kept when there are ``now``; logarithmically many are.

    A history that branches off from the one they belong to is thus replayed from at most twice as long ago.
    """
    apart = CHECKPOINT
    while now - at > CLOSE * apart:
        apart *= 2
    return at % apart == 0
