"""A keyframe with known association: each detection is of the object that it names, or its name is wrong."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.keyframe.open_keyframe import OpenKeyframe
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate


@dataclass(frozen=True, kw_only=True)
class NamedKeyframe(OpenKeyframe):
    """The keyframe of P parents that know the same objects; n of its detections carry a name."""

    named: Index  # (n,) those detections
    identities: Index  # (n,) ids of the objects that they name
    first: Index  # (m,) which of the n are the first of their object, and start it
    log_wrong: Array  # (P, n) log odds that the name is wrong, times the density of the detection if it is

    @property
    def used(self) -> Index:
        """(n,) the detections that carry a name."""
        return self.named

    @cached_property
    def detections(self) -> Sequence[Any]:
        """(n,) those detections."""
        return [self.step.detections[number] for number in self.named]

    @property
    def born(self) -> Index:
        """(n,) ids of the named objects: those that are not known start with their first detection."""
        return self.identities

    def existence(self, candidates: WeighedAssociations) -> tuple[Array, Sequence[ExistenceUpdate]]:
        """Factors of wrong names and first detections, and updates: objects exist for sure, and misses do not count."""
        rows, log_wrong, clutter = candidates.assignments, self.log_wrong, self.problem.clutter
        if clutter is not None:
            log_wrong = log_wrong + clutter.log_scores(self.detections)
        factors = np.where(rows.objects < 0, log_wrong[rows.parents], 0.0).sum(axis=1)
        factors += np.array([self._log_first(own.births) for own in self.predictions])[rows.parents]
        new = self.identities[self.first].tolist()
        updates = [ExistenceUpdate.starting(component.objects, new) for component in self.parents.components]
        return factors, [updates[parent] for parent in rows.parents.tolist()]

    def _log_first(self, births: list[Birth]) -> float:
        """Log density of the first detections under their objects' broad priors, relative to the stand-in priors."""
        total = 0.0
        for number in self.first.tolist():
            born = births[number]
            if self.detections[number].has_range:
                spread = born.prior.covariance[:2, :2]
                total += born.log_area - 0.5 * float(np.linalg.slogdet(2.0 * np.pi * spread)[1]) - born.log_stand_in
        return total

    @cached_property
    def _births(self) -> list[dict[int, GaussianPrior]]:
        """Priors of the objects that are named for the first time, for each parent."""
        return [
            {int(self.identities[number]): own.births[number].prior for number in self.first.tolist()}
            for own in self.predictions
        ]
