"""Association with a known map: enumerates all assignments of detections to its objects that the gates admit."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.closed_keyframe import ClosedKeyframe
from semantic_slam.inference.association.closed_world import ClosedWorld, expected_along
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.association.used_detections import used_detections
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.objects import ObjectRegistry


class EnumeratedAssociation(ClosedWorld):
    """Strategy ``enumerated``: a detection is of a mapped object, or clutter (a false alarm or an unmapped object)."""

    needs_map, wants_identities = True, False

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """Do nothing: all objects are on the map."""

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> ClosedKeyframe:
        """The keyframe as predicted for the parents; with a ``path`` on a large map only its objects are predicted."""
        known = [n for n in self.registry.known.ids if n in parents.components[0].object_ids]
        known, used = expected_along(path, known), used_detections(self.problem, step)
        return ClosedKeyframe(
            problem=self.problem,
            registry=self.registry,
            step=step,
            parents=parents,
            path=path,
            used=used,
            known=known,
            log_clutter=self._log_clutter([step.detections[i] for i in used]),
        )

    def _log_clutter(self, detections: Sequence[Any]) -> Array | None:
        """(n,) log intensity of clutter at each detection, relative to a detection probability of 1/2 for objects."""
        rate, clutter = self.problem.clutter_rate, self.problem.clutter
        return np.log(rate) + clutter.log_place(detections) if clutter is not None and rate > 0.0 else None
