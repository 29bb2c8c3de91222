"""The candidates of one keyframe with the least-squares problems that weigh them, as passed through the expander."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.innovation import innovation_nees
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.evidence.laplace import Mode
from semantic_slam.inference.states.lineage import LineageStep, lineage_steps


@dataclass(frozen=True, kw_only=True)
class WeighedAssociations:
    """K candidates of P parents, at any stage between enumeration and weighing."""

    assignments: Assignments  # K
    object_ids: Index  # (O,) ids of the objects that ``assignments.objects`` refers to
    log_left_out: Array  # (P,) log mass that was not enumerated, relative to the best candidate of the parent
    problem: KeyframeProblem | None = None  # K least-squares problems; None where weights come from a linearisation
    start: Array | None = None  # (K, m) whitened states from which their modes are searched
    mode: Mode | None = None  # K, once they have been searched
    num_new: int = 0  # number of objects that this keyframe introduces, the last ones of ``object_ids``

    def gaining(self, **columns: Any) -> "WeighedAssociations":
        """The candidates with more columns of the table of assignments."""
        return replace(self, assignments=self.assignments.gaining(**columns))

    def take(self, rows: Index) -> "WeighedAssociations":
        """Some of the candidates, with their problems and modes where they have been searched."""
        return replace(
            self,
            assignments=self.assignments.take(rows),
            problem=None if self.problem is None else self.problem.select(rows),
            start=None,
            mode=None if self.mode is None else self.mode.take(rows),
        )

    def steps(self, used: Index, num_detections: int) -> list[LineageStep]:
        """Lineage steps of the candidates, which associate the ``used`` (n,) detections of the keyframe."""
        rows = self.assignments
        return lineage_steps(rows.object_ids(self.object_ids), rows.classes, rows.numbers, used, num_detections)

    def solved(self) -> tuple[KeyframeProblem, Mode]:
        """The problems and their modes, for candidates that have both."""
        assert self.problem is not None and self.mode is not None
        return self.problem, self.mode

    def at_modes(self) -> "WeighedAssociations":
        """The candidates with states and covariances of the robot and of each detection's object, and innovations."""
        problem, mode = self.solved()
        states, covariances, crosses = problem.marginals(mode.y, mode.hessian)
        robot, landmark = slice(problem.layout.robot), slice(problem.layout.landmark)
        return self.gaining(
            robot=problem.robots_of(states),
            robot_covariance=covariances[:, 0, robot, robot],
            object_states=_of_detections(problem, states)[..., : problem.spaces.storage.landmark],
            object_covariances=_of_detections(problem, covariances)[..., landmark, landmark],
            object_crosses=_of_detections(problem, crosses)[..., landmark],
            innovation_nees=innovation_nees(problem, mode.y, len(self.object_ids) - self.num_new),
        )


def _of_detections(problem: KeyframeProblem, values: Array) -> Array:
    """(K, 1 + n, ...) values of the blocks to (K, n, ...) of the objects that the detections are associated with."""
    return np.asarray(values[np.arange(len(values))[:, None], 1 + problem.slots])
