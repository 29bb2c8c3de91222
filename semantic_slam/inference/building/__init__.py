"""From a configuration to a run: its announcement, and the problem and reference model that follow from it."""

from semantic_slam.inference.building.announcement import check_run, make_run_configuration
from semantic_slam.inference.building.initial_pose import initial_pose_of, start_of_run
from semantic_slam.inference.building.problem import problem_of
from semantic_slam.inference.building.reference import reference_of

__all__ = [
    "check_run",
    "initial_pose_of",
    "make_run_configuration",
    "problem_of",
    "reference_of",
    "start_of_run",
]
