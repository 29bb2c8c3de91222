"""What the expander hands from step to step: the candidates of one keyframe and the problem that weighs them."""

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
class Candidates:
    """K candidates of P parents."""

    assignments: Assignments  # K
    object_ids: Index  # (O,) that ``assignments.objects`` refers to
    log_left_out: Array  # (P,) mass that was not enumerated, relative to the best candidate of the parent
    problem: KeyframeProblem | None = None  # K least-squares problems; None where a linearisation weighs them
    start: Array | None = None  # (K, m) whitened states from which their modes are searched
    mode: Mode | None = None  # K, where they have been searched
    num_new: int = 0  # the last of the objects, which this keyframe introduces

    def gaining(self, **columns: Any) -> "Candidates":
        """The candidates with more columns of the table of assignments."""
        return replace(self, assignments=self.assignments.gaining(**columns))

    def take(self, rows: Index) -> "Candidates":
        """Some of the candidates, with their problems and modes where they have been searched."""
        return replace(
            self,
            assignments=self.assignments.take(rows),
            problem=None if self.problem is None else self.problem.select(rows),
            start=None,
            mode=None if self.mode is None else self.mode.take(rows),
        )

    def steps(self, used: Index, num_detections: int) -> list[LineageStep]:
        """What the keyframe adds to the lineages; the candidates are about the ``used`` (n,) of its detections."""
        rows = self.assignments
        return lineage_steps(rows.object_ids(self.object_ids), rows.classes, rows.numbers, used, num_detections)

    def solved(self) -> tuple[KeyframeProblem, Mode]:
        """The problem and its modes, of candidates that have both."""
        assert self.problem is not None and self.mode is not None
        return self.problem, self.mode

    def at_modes(self) -> "Candidates":
        """The candidates with states and covariances of the robot and of each detection's object, and innovations."""
        problem, mode = self.solved()
        states, covariances = problem.marginals(mode.y, mode.hessian)
        robot, landmark = slice(problem.layout.robot), slice(problem.layout.landmark)
        return self.gaining(
            robot=problem.robots_of(states),
            robot_covariance=covariances[:, 0, robot, robot],
            object_states=_of_detections(problem, states)[..., : problem.spaces.storage.landmark],
            object_covariances=_of_detections(problem, covariances)[..., landmark, landmark],
            innovation_nees=innovation_nees(problem, mode.y, len(self.object_ids) - self.num_new),
        )


def _of_detections(problem: KeyframeProblem, values: Array) -> Array:
    """(K, 1 + n, ...) values of the blocks to (K, n, ...) of the objects that the detections are associated with."""
    return np.asarray(values[np.arange(len(values))[:, None], 1 + problem.slots])
