"""A backend that carries a given number of hypotheses through a world, none pruned: what growth is measured on."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.backend import Backend
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam_lab.grid.run import Setting, keyframes_of, run_of
from semantic_slam_lab.grid.world import Noise, World

TRACKED = Noise(robot=(0.25, 0.25, 0.01))
"""The robot knows about where it starts; the hypotheses differ in classes and associations."""


class HypothesisFan:
    """``number`` hypotheses of a world in one backend: the best candidates until there are so many, then each parent's
    best child. All get the same weight, so that none is spared work for being unlikely.
    """

    def __init__(self, world: World, number: int, setting: Setting | None = None):
        run = run_of(world, setting)
        self.number, self._run_id = number, run.run_id
        self._keyframes = keyframes_of(world, setting)
        self._backend = Backend(0)
        self._backend.start(run)
        self._ids = np.array([ROOT_ID], dtype=np.uint64)

    def advance(self, count: int) -> None:
        """Take in the next ``count`` keyframes."""
        for _ in range(count):
            self.step()

    def step(self) -> int:
        """One keyframe, expand and commit; returns the number of candidates."""
        found = self._backend.expand(self._next())
        self._backend.commit(self.commit(found))
        return len(found.ids)

    def commit(self, found: Candidates) -> Commit:
        """The survivors of these candidates. Raises ValueError where they are fewer than the parents."""
        full = len(self._ids) == self.number
        kept = _best_children(found) if full else np.argsort(-found.log_weights, kind="stable")[: self.number]
        if len(kept) < len(self._ids):
            raise ValueError(f"{len(kept)} of {len(self._ids)} hypotheses have a continuation")
        self._ids = found.ids[kept]
        return Commit(
            run_id=self._run_id,
            keyframe=found.keyframe,
            ids=self._ids,
            parent_ids=found.parent_ids[kept],
            steps=tuple(_step(found, row) for row in kept),
            log_weights=np.full(len(kept), -np.log(len(kept))),
            owners=np.zeros(len(kept), dtype=np.uint32),
            lineages=((),) * len(kept),
        )

    def __len__(self) -> int:
        return len(self._ids)

    def _next(self) -> Keyframe:
        return self._keyframes[self._backend.committed + 1]


def _best_children(found: Candidates) -> NDArray[np.int_]:
    """(P,) row of the best candidate of every parent."""
    order = np.argsort(-found.log_weights, kind="stable")
    _, first = np.unique(found.parent_ids[order], return_index=True)
    return np.asarray(order[first])


def _step(found: Candidates, row: int) -> LineageStep:
    association: Sequence[int] = found.associations[row].tolist()
    return LineageStep(tuple(association), tuple(found.class_assignments[row].tolist()), int(found.modes[row]))
