"""The two rounds of a keyframe between manager and backends, with recovery when a backend does not answer.

A backend that dies takes its components with it, but no hypothesis is lost: a component is determined by its lineage,
so that another backend can rebuild it bit by bit. See docs/architecture.md.
"""

from collections import Counter
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.hypotheses import Hypotheses, Hypothesis, redistributed
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.object_table import ObjectTable, over, table_row
from semantic_slam.inference.protocol import LOST, BackendPool, Candidates, Components
from semantic_slam.inference.world.objects import ReportedObjects

MOST_REPEATS = 3
"""How often a round is repeated: each time because backends died in it, or were restarted and hold nothing yet."""


@dataclass(frozen=True, kw_only=True)
class HeldComponent:
    """A backend's report of one component that it holds: marginals of robot, objects and noise."""

    pose: Array  # (7,) robot in map
    covariance: Array  # (6, 6)
    objects: ObjectTable  # (O, ...)
    noise: Array  # (N, 2)


@dataclass(frozen=True, kw_only=True)
class Committed:
    """Result of a commit: the hypotheses with their present owners, and their components as backends hold them."""

    hypotheses: dict[int, Hypothesis]
    components: dict[int, HeldComponent]  # without those that backends lost
    reported: ReportedObjects  # the rows of the components' objects


class Rounds:
    """Runs both rounds with the backends of ``pool``; hypotheses that a backend lost are rebuilt by the others."""

    STATE: ClassVar[tuple[str, ...]] = ("lost",)

    def __init__(self, pool: BackendPool, run_id: str, hypotheses: Hypotheses) -> None:
        self._pool, self._run_id, self._hypotheses = pool, run_id, hypotheses
        self.lost: Counter[str] = Counter()  # hypotheses that backends had to give up, by reason

    def expand(self, keyframe: Keyframe, index: int) -> CandidateTable:
        """Round one: the candidates of every live hypothesis (Eqs. 4.11, 4.18)."""
        answers = self._pool.expand(keyframe)
        for _ in range(MOST_REPEATS):
            if not self._missing(answers):
                return CandidateTable.of(answers)
            self._rebuild_elsewhere(index)
            answers = self._pool.expand(keyframe)
        if self._missing(answers):
            raise SemanticSlamError(f"backends lost hypotheses {MOST_REPEATS + 1} times in a row; see their logs")
        return CandidateTable.of(answers)

    def commit(self, index: int, children: dict[int, Hypothesis]) -> tuple[dict[int, Hypothesis], list[Components]]:
        """Round two: update the survivors (Eqs. 4.9, 4.10); return them with their present owners, and all answers."""
        answers = self._pool.commit(self._hypotheses.commit(self._run_id, index, children))
        for _ in range(MOST_REPEATS):
            if not (_unanswered(children, answers) and self._pool.backend_ids):
                break
            children = redistributed(children, self._pool.backend_ids)
            again = self._hypotheses.commit(self._run_id, index, children, always_lineage=True)
            answers = self._pool.commit(again)
        self._count_lost(children, answers)
        return children, answers

    def _missing(self, answers: list[Candidates]) -> set[int]:
        """Ids of live hypotheses that no backend has expanded."""
        return set(self._hypotheses.live) - {int(n) for answer in answers for n in answer.expanded_parent_ids}

    def _rebuild_elsewhere(self, index: int) -> None:
        """Redistribute the live hypotheses over the available backends, which rebuild missing ones from lineages."""
        if not self._pool.backend_ids:
            raise SemanticSlamError("no backend is left; start the backends and run again")
        if index == 0:  # every backend has the roots
            return
        self._hypotheses.live = redistributed(self._hypotheses.live, self._pool.backend_ids)
        commit = self._hypotheses.commit(self._run_id, index - 1, self._hypotheses.live, always_lineage=True)
        self._pool.commit(commit)

    def _count_lost(self, children: dict[int, Hypothesis], answers: list[Components]) -> None:
        """Count the lost components by reason. Raises SemanticSlamError when no component is left."""
        lost = Counter(reason for answer in answers for reason in answer.lost_reasons)
        lost += Counter({"no backend answered": len(_unanswered(children, answers))})
        self.lost.update({f"{LOST}: {reason}": count for reason, count in lost.items()})
        if not any(len(answer.ids) for answer in answers):
            reasons = "; ".join(f"{count} x {reason}" for reason, count in lost.most_common(3))
            raise SemanticSlamError(f"every hypothesis was lost ({reasons}); check noise parameters and backends")


def held_components(answers: list[Components], reported: ReportedObjects) -> dict[int, HeldComponent]:
    """Hypothesis id -> report of its component, with rows for all ``reported`` objects."""
    return {
        int(number): HeldComponent(
            pose=answer.poses[row],
            covariance=answer.pose_covariances[row],
            objects=table_row(answer.objects, row),
            noise=answer.noise[row],
        )
        for answer in (_aligned(answer, reported) for answer in answers)
        for row, number in enumerate(answer.ids)
    }


def _aligned(answer: Components, reported: ReportedObjects) -> Components:
    """An answer extended to all reported objects, of which its backend may know only some."""
    ids = np.array(reported.ids, dtype=np.uint32)
    if np.array_equal(ids, answer.object_ids):
        return answer
    places = np.array([reported.row_of[n] for n in answer.object_ids.tolist()], dtype=int)
    return replace(answer, object_ids=ids, objects=over(answer.objects, places, reported.class_prior))


def _unanswered(children: dict[int, Hypothesis], answers: list[Components]) -> set[int]:
    """Ids of survivors that no backend reports as held or as lost."""
    return set(children) - {int(n) for answer in answers for n in (*answer.ids, *answer.lost_ids)}
