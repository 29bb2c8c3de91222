"""The live hypotheses of a run: weights, lineages, and which backend holds each."""

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.evidence.bagging import Bagging
from semantic_slam.inference.ownership import assign_owners
from semantic_slam.inference.protocol import Commit
from semantic_slam.inference.pruning import Pruned
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import Lineage, LineageStep, revised
from semantic_slam.inference.world.carried import new_grounds
from semantic_slam.inference.world.problem import Problem

RECENT_KEYFRAMES = 10
"""Number of keyframes in ``discarded_mass_window``: mass discarded before that has shown its effect, or never will."""

MOST_DISCARDED = 1.0 - 1e-12
"""Upper limit of a keyframe's discarded share, so that mass that is found again later can be counted back."""


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """One component of the mixture: a history of associations, classes and modes (its lineage), and its weight."""

    owner: int  # backend that holds its component
    log_weight: float
    parent_id: int
    lineage: Lineage  # one step for every keyframe
    grounds: tuple[int, ...] = field(default=(), compare=False)  # keyframes before which it was carried to new ground
    revises: "Hypothesis | None" = None  # when it enters as a revision: the live hypothesis whose history it revises
    replayed: Component | None = field(default=None, compare=False, repr=False)  # its component, if made by a replay
    replicates: Array = field(default_factory=lambda: np.zeros(0), compare=False, repr=False)  # (B,) see ``Bagging``

    @property
    def told_parent_id(self) -> int:
        """Parent id to report: a revision's own parent was not live, so it reports that of what it revises."""
        return self.parent_id if self.revises is None else self.revises.parent_id

    def changes(self) -> list[tuple[int, int, int]]:
        """(keyframe, detection, object or -1) wherever a revision differs from the history that it revises."""
        if self.revises is None:
            return []
        pairs = zip(self.revises.lineage, self.lineage, strict=True)
        return [
            (keyframe, detection, number)
            for keyframe, (before, after) in enumerate(pairs)
            for detection, number in enumerate(after.association)
            if number != before.association[detection]
        ]


@dataclass
class DiscardedMass:
    """Probability mass lost to pruning, gating and lost components; d_k is the share that keyframe k discarded."""

    log_kept: float = 0.0  # log prod_k (1 - d_k)
    lately: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT_KEYFRAMES))  # log (1 - d_k)

    def add(self, log_kept: float) -> None:
        """Count the mass that one more keyframe discards."""
        self.log_kept += log_kept
        self.lately.append(log_kept)

    def find(self, log_found: float) -> None:
        """Take back discarded mass that was found again, given as its log ratio to the kept mass; total stays >= 0.

        It is taken off the newest keyframes first, so that no part of the sum exceeds the whole.
        """
        self.log_kept = min(0.0, self.log_kept + log_found)
        for place in reversed(range(len(self.lately))):
            kept = min(0.0, self.lately[place] + log_found)
            log_found -= kept - self.lately[place]
            self.lately[place] = kept

    @property
    def total(self) -> float:
        """1 - prod_k (1 - d_k), since the start."""
        return max(0.0, float(-np.expm1(self.log_kept)))

    @property
    def window(self) -> float:
        """1 - prod_k (1 - d_k) over the last keyframes, a part of ``total``."""
        return min(self.total, max(0.0, float(-np.expm1(sum(self.lately)))))


class Hypotheses:
    """The set of live hypotheses; ids are digests of content, so that every process names a hypothesis alike."""

    STATE: ClassVar[tuple[str, ...]] = ("live", "discarded")

    def __init__(self, log_root_weights: Sequence[float], owner: int, bagging: Bagging) -> None:
        """Start with one root hypothesis for each noise setting that is to be decided by the evidence."""
        self.bagging = bagging
        self.live = {
            ROOT_ID + root_number: Hypothesis(
                owner=owner,
                log_weight=log_weight,
                parent_id=ROOT_ID + root_number,
                lineage=(),
                replicates=bagging.begun(log_weight),
            )
            for root_number, log_weight in enumerate(log_root_weights)
        }
        self.discarded = DiscardedMass()

    def __len__(self) -> int:
        return len(self.live)

    @property
    def num_keyframes(self) -> int:
        """Number of keyframes so far, the length of every live lineage."""
        return len(next(iter(self.live.values())).lineage)

    def root_numbers(self, candidates: CandidateTable, problem: Problem) -> NDArray[np.int_]:
        """(K,) root number of each candidate's history, see `Problem.root_number`."""
        known = {
            n: problem.root_number(hypothesis.lineage) if hypothesis.lineage else n - ROOT_ID
            for n, hypothesis in self.live.items()
        }
        return np.array([known[n] for n in candidates.parent_ids.tolist()], dtype=int)

    def children(self, candidates: CandidateTable, pruned: Pruned, backend_ids: Sequence[int]) -> dict[int, Hypothesis]:
        """The surviving candidates, heaviest first; each stays with its parent's owner while that backend has room."""
        parents = [self.live[int(candidates.parent_ids[row])] for row in pruned.kept]
        length = 1 + max((len(parent.lineage) for parent in parents), default=0)
        owners = assign_owners([parent.owner for parent in parents], backend_ids, length)
        rows = zip(pruned.kept, owners, parents, pruned.log_weights, strict=True)
        return {
            int(candidates.ids[row]): replace(
                _child(parent, owner, float(log_weight), int(candidates.parent_ids[row]), candidates.step(row)),
                replicates=self.bagging.grown(
                    parent.replicates, length - 1, float(candidates.log_weights[row]) - parent.log_weight
                ),
            )
            for row, owner, parent, log_weight in rows
        }

    def accept(self, children: dict[int, Hypothesis], held: Collection[int], discarded: float) -> None:
        """Make those children live whose components are ``held``; the others add to the discarded mass.

        ``discarded`` is the share of the mass that pruning discarded at this keyframe.
        """
        kept, log_total = _held(children, held)
        self.discarded.add(float(np.log1p(-min(discarded, MOST_DISCARDED))) + min(log_total, 0.0))
        self.live = kept

    def enter(self, children: dict[int, Hypothesis], held: Collection[int], log_found: float) -> None:
        """Make those ``children`` live whose components are ``held``, among them revisions and replays.

        The mass that these found again (``log_found``, relative to the kept mass) is taken off the discarded mass.
        """
        kept, _ = _held(children, held)
        self.discarded.find(log_found)
        self.live = {n: replace(child, replayed=None) for n, child in kept.items()}

    def commit(
        self, run_id: str, keyframe: int, children: dict[int, Hypothesis], *, always_lineage: bool = False
    ) -> Commit:
        """The commit message of the survivors; lineages are sent only to owners that do not hold the parent."""
        holds = {n: live.owner for n, live in self.live.items()}
        moved = [always_lineage or holds.get(child.parent_id) != child.owner for child in children.values()]
        return Commit(
            run_id=run_id,
            keyframe=keyframe,
            ids=np.array(list(children), dtype=np.uint64),
            parent_ids=np.array([child.parent_id for child in children.values()], dtype=np.uint64),
            steps=tuple(child.lineage[-1] for child in children.values()),
            log_weights=np.array([child.log_weight for child in children.values()]),
            owners=np.array([child.owner for child in children.values()], dtype=np.uint32),
            lineages=tuple(
                child.lineage[:-1] if move else () for child, move in zip(children.values(), moved, strict=True)
            ),
        )


def _child(parent: Hypothesis, owner: int, log_weight: float, parent_id: int, step: LineageStep) -> Hypothesis:
    """The continuation of a hypothesis; one whose step changes past associations is a revision of the plain one."""
    plain = Hypothesis(
        owner=owner,
        log_weight=log_weight,
        parent_id=parent_id,
        lineage=(*parent.lineage, step),
        grounds=(*parent.grounds, *new_grounds([step], len(parent.lineage))),
    )
    if not step.changes:
        return plain
    return replace(plain, lineage=(*revised(parent.lineage, step.changes), step), revises=plain)


def _held(children: dict[int, Hypothesis], held: Collection[int]) -> tuple[dict[int, Hypothesis], float]:
    """The children whose components are ``held``, with normalised weights, and their log total before that."""
    kept = {n: child for n, child in children.items() if n in held}
    log_total = float(np.logaddexp.reduce([child.log_weight for child in kept.values()]))
    return {n: replace(child, log_weight=child.log_weight - log_total) for n, child in kept.items()}, log_total


def redistributed(hypotheses: dict[int, Hypothesis], backend_ids: Sequence[int]) -> dict[int, Hypothesis]:
    """The hypotheses, reassigned to the backends that are still available."""
    length = max((len(live.lineage) for live in hypotheses.values()), default=0)
    owners = assign_owners([live.owner for live in hypotheses.values()], backend_ids, length)
    return {n: replace(live, owner=owner) for (n, live), owner in zip(hypotheses.items(), owners, strict=True)}
