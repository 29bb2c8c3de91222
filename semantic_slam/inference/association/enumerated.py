"""Association with a known map: every assignment of the detections to its objects that the gates admit."""

from collections.abc import Collection

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.association.closed_keyframe import ClosedKeyframe
from semantic_slam.inference.association.map_gate import FEW_OBJECTS
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.evidence.allocation import keep_freed_memory
from semantic_slam.inference.evidence.importance import normal_points
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem


class EnumeratedAssociation:
    """The map prior holds all objects; a detection is of one of them."""

    carries_views = tracks_objects = False
    needs_map, wants_identities, counts_misses, merges_copies = True, False, False, False

    def __init__(self, problem: Problem, registry: ObjectRegistry) -> None:
        self.problem, self.registry = problem, registry
        warm_up(problem)

    @staticmethod
    def check(configuration: Configuration) -> None:
        """Accept every configuration: any other parameters go together with enumeration."""

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """All objects are on the map."""

    @staticmethod
    def reported(registry: ObjectRegistry, alive: Collection[int]) -> ReportedObjects:
        """All objects of the map, seen or not."""
        return registry.known

    def root(self, number: int) -> Component:
        """The component before any keyframe."""
        return self.problem.root()

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> ClosedKeyframe:
        """Along a ``path`` through a large map, the objects of that path alone."""
        known = [n for n in self.registry.known.ids if n in parents.components[0].object_ids]
        if path is not None and len(known) > FEW_OBJECTS:
            known = [n for n in known if n in path.association]
        return ClosedKeyframe(
            problem=self.problem,
            registry=self.registry,
            step=step,
            parents=parents,
            path=path,
            used=self._used(step),
            known=known,
        )

    def _used(self, step: Step) -> Index:
        """The best-scored detections where there are more than objects."""
        num_objects = len(self.registry.known.ids)
        limit = num_objects if self.problem.distinct else (len(step.names) if num_objects else 0)
        order = np.argsort(-step.scores, kind="stable")
        return np.asarray(np.sort(order[:limit]))


def warm_up(problem: Problem) -> None:
    """Do what would make the first keyframe take longer than the others."""
    if problem.weights.method == "importance":
        normal_points(1, 1)  # what it imports takes longer than a keyframe may
        keep_freed_memory()
