"""Association by identities that come with the detections."""

from collections.abc import Collection

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.association.closed_keyframe import ClosedKeyframe
from semantic_slam.inference.association.enumerated import warm_up
from semantic_slam.inference.association.map_gate import FEW_OBJECTS
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem


class GivenAssociation:
    """Each detection names its object; a new name is a new object, and a detection without a name is clutter."""

    carries_views = tracks_objects = False
    needs_map, wants_identities, counts_misses, merges_copies = False, True, False, False

    def __init__(self, problem: Problem, registry: ObjectRegistry) -> None:
        self.problem, self.registry = problem, registry
        warm_up(problem)

    @staticmethod
    def check(configuration: Configuration) -> None:
        """Any other parameters go together with it."""

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """The objects that are named for the first time."""
        for name in step.names:
            registry.identify(name)

    @staticmethod
    def reported(registry: ObjectRegistry, alive: Collection[int]) -> ReportedObjects:
        """All objects of the map and all that were named."""
        return registry.known

    def root(self, number: int) -> Component:
        """The component before any keyframe."""
        return self.problem.root()

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> ClosedKeyframe:
        """About the objects that the keyframe names; along a ``path`` through many of them, those of that path."""
        identities = [self.registry.identify(name) for name in step.names]
        used = np.array([i for i, number in enumerate(identities) if number >= 0], dtype=int)
        named = sorted({identities[i] for i in used})
        known = [n for n in named if n in parents.components[0].object_ids]
        if path is not None and len(known) > FEW_OBJECTS:
            known = [n for n in known if n in path.association]
        unknown = [n for n in named if n not in parents.components[0].object_ids]
        return ClosedKeyframe(
            problem=self.problem,
            registry=self.registry,
            step=step,
            parents=parents,
            path=path,
            used=used,
            known=known,
            identities=[identities[i] for i in used],
            new=[self._priors(component, step, used, identities, unknown) for component in parents.components],
        )

    def _priors(
        self, component: Component, step: Step, used: Index, identities: list[int], unknown: list[int]
    ) -> dict[int, GaussianPrior]:
        """Broad priors about where this hypothesis first sees the objects that it does not know."""
        if not unknown:
            return {}
        robot = self.problem.spaces.robot.compose(component.newest_robot(), step.motion.control)
        first = {n: next(step.detections[i] for i in used if identities[i] == n) for n in unknown}
        return {n: self.problem.model.object_prior(detection, robot) for n, detection in first.items()}
