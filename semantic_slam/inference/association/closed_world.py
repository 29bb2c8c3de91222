"""Base of the closed-world association strategies, where all objects are on a map or named by detections."""

from collections.abc import Collection
from typing import Any

from semantic_slam.configuration import Configuration
from semantic_slam.inference.association.map_gate import FEW_OBJECTS
from semantic_slam.inference.evidence.allocation import keep_freed_memory
from semantic_slam.inference.evidence.importance import normal_points
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem
from semantic_slam.inference.world.roots import closed_root


class ClosedWorld:
    """The part of an association strategy that closed worlds share; subclasses say what they need, and predict."""

    defers_view_factors = tracks_objects = counts_misses = merges_copies = False

    def __init__(self, problem: Problem, registry: ObjectRegistry) -> None:
        self.problem, self.registry = problem, registry
        warm_up(problem)

    @classmethod
    def suited_to(cls, configuration: Configuration) -> type[Any]:
        """The class itself, for every configuration."""
        return cls

    @staticmethod
    def check(configuration: Configuration) -> None:
        """Accept every configuration: any other parameters go together with a closed world."""

    @staticmethod
    def reported(registry: ObjectRegistry, alive: Collection[int]) -> ReportedObjects:
        """All objects of the map and all that detections named, seen or not."""
        return registry.stated

    def root(self, root_number: int) -> Component:
        """The component before any keyframe."""
        return closed_root(self.problem)


def expected_along(path: LineageStep | None, known: list[int]) -> list[int]:
    """The objects to predict: ``known`` ones; when replaying a ``path`` among many, only those that it names.

    If all detections of the path are clutter, one object is returned, so that arrays of objects are not empty.
    """
    if path is None or len(known) <= FEW_OBJECTS:
        return known
    return [n for n in known if n in path.association] or known[:1]


def warm_up(problem: Problem) -> None:
    """Do imports and allocations in advance that would delay the first keyframe."""
    if problem.weights.method == "importance":
        normal_points(1, 1)  # its import takes longer than a keyframe may
        keep_freed_memory()
