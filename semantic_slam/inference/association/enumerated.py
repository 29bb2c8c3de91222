"""Association with a known map: every assignment of the detections to its objects that the gates admit."""

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.association.closed_keyframe import ClosedKeyframe
from semantic_slam.inference.association.closed_world import ClosedWorld, expected_along
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.objects import ObjectRegistry


class EnumeratedAssociation(ClosedWorld):
    """The map prior holds all objects; a detection is of one of them."""

    needs_map, wants_identities = True, False

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """All objects are on the map."""

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> ClosedKeyframe:
        """Along a ``path`` through a large map, the objects of that path alone."""
        known = [n for n in self.registry.known.ids if n in parents.components[0].object_ids]
        known = expected_along(path, known)
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
