"""Retrospective association weights of every detection of a drive, by the path and map as now known.

Path and camera mount are taken as known, and tracks of boxes are ignored. That suffices to select histories to replay.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.observation import Innovation
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.semantics.interface import RanksPairs
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.states.keys import robot_key
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem

HIDES = 0.9
"""Existence above which an object occludes others, and may own detections of another one."""


@dataclass(frozen=True, kw_only=True)
class Hindsight(ABC):
    """A history of T keyframes with N objects; each detection is of one of them or of none."""

    problem: Problem
    registry: ObjectRegistry
    steps: Sequence[Step]  # T
    lineage: Lineage  # T
    component: Component  # after these

    @classmethod
    def of(cls, replay: Replay, registry: ObjectRegistry, followed: Revised) -> Self:
        """The hindsight of a history that was replayed."""
        return cls(
            problem=replay.problem,
            registry=registry,
            steps=replay.steps,
            lineage=followed.lineage,
            component=followed.component,
        )

    @property
    @abstractmethod
    def in_view(self) -> Flags:
        """(N, T) whether each object is in the region and not occluded, at each keyframe."""

    @abstractmethod
    def log_of_none(self, step: Step, robot: Array, owners: Index) -> Array:
        """(D,) log weights of detections by position, as first detections or false alarms on ground seen before.

        ``owners`` (D,) are the objects that they are assigned to.
        """

    @abstractmethod
    def log_ranges(self, step: Step, robot: Array) -> tuple[Array, Array]:
        """(D, N) log ranges of the objects, and their variances."""

    def log_density(self, innovation: Innovation, sizes: Index) -> Array:
        """(K,) log densities of pairs by position, of which ``sizes`` (K,) components are measured."""
        return innovation.log_density

    @cached_property
    def ids(self) -> Index:
        """(N,) ids of the existing objects."""
        objects = self.component.objects
        return np.asarray(objects.ids[objects.existence > HIDES])

    @cached_property
    def owners(self) -> list[Index]:
        """T of (D,) which object each detection is of; N: of none of them."""
        row = {number: place for place, number in enumerate(self.ids.tolist())}
        return [np.array([row.get(n, len(row)) for n in step.association], dtype=int) for step in self.lineage]

    @cached_property
    def log_weights(self) -> list[Array]:
        """T of (D, N + 1) log weights of detections as one of each object, and as one of none of them."""
        given = zip(self.steps, self.path, self.owners, strict=True)
        return [self._weighed(step, robot, owners) for step, robot, owners in given]

    @cached_property
    def first_seen(self) -> Index:
        """(N,) keyframe of the first detection of each object; T without any."""
        found = np.full(len(self.ids) + 1, len(self.steps))
        for keyframe in reversed(range(len(self.steps))):
            found[self.owners[keyframe]] = keyframe
        return found[:-1]

    def detected_at(self, row: int) -> Flags:
        """(T,) whether the object in that row is detected, at each keyframe."""
        return np.array([(own == row).any() for own in self.owners], dtype=bool)

    @property
    def log_unseen(self) -> float:
        """Log of the least share of births that remains where the camera has looked before."""
        with np.errstate(divide="ignore"):
            return float(np.log(self.problem.open_world.least_undetected_share))

    @property
    def log_missed(self) -> float:
        """Log probability of missing an object in view."""
        return float(np.log1p(-self.detected))

    @cached_property
    def detected(self) -> float:
        """Detection probability of an object in view."""
        rates = self.component.objects.rates
        return float(rates.average(rates.probability))

    @cached_property
    def path(self) -> Array:
        """(T, s) smoothed robot path, as of now."""
        return self.component.states([robot_key(k) for k in range(len(self.steps))])

    @cached_property
    def places(self) -> Array:
        """(N, s) states of the objects."""
        return np.asarray(tracked_states(self.component).states[self._rows])

    @property
    def spreads(self) -> Array:
        """(N, l, l) covariances of the objects."""
        return np.asarray(tracked_states(self.component).covariances[self._rows])

    def log_of_one(self, one: int, other: int) -> float:
        """Log evidence of the words of two objects, by id, as of one, relative to that as of two."""
        semantics, views = self.problem.semantics, self.component.views
        if not isinstance(semantics, RanksPairs) or one not in views or other not in views:
            return 0.0
        return semantics.log_of_one(views[one], views[other], self.registry.log_class_prior_of([one])[0])

    @cached_property
    def _rows(self) -> Index:
        return self.component.objects.rows(self.ids)

    def _weighed(self, step: Step, robot: Array, owners: Index) -> Array:
        found = np.zeros((len(step.detections), len(self.ids) + 1))
        found[:, -1] = self.log_of_none(step, robot, owners)
        if found.size and len(self.ids):
            found[:, :-1] = self._by_place(step, robot) + np.log(self.detected)
        return found + self._by_word(step, robot)

    def _by_place(self, step: Step, robot: Array) -> Array:
        """(D, N) log densities by direction, and by range where measured."""
        model, count = self.problem.model, len(self.ids)
        numbers, columns = np.divmod(np.arange(len(step.detections) * count), count)
        robots = np.broadcast_to(robot, (len(numbers), len(robot)))
        part = model.geometry(model.collect(step.detections).take(numbers), robots, self.places[columns])
        innovation = Innovation.of(part, part.jacobian_object, self.spreads[columns])
        return self.log_density(innovation, part.measured.sum(axis=1)).reshape(-1, count)

    def _by_word(self, step: Step, robot: Array) -> Array:
        """(D, N + 1) log evidence of detector labels."""
        semantics, found = self.problem.semantics, np.zeros((len(step.detections), len(self.ids) + 1))
        if step.words is None or not isinstance(semantics, RanksPairs) or not found.size:
            return found
        numbers = self.ids.tolist()
        log_prior = self.registry.log_class_prior_of([*numbers, self.registry.first_new_id(step.index)])
        trackless = replace(step, names=("",) * len(step.names))
        return semantics.log_pairs(trackless, self.component.views, numbers, log_prior, *self.log_ranges(step, robot))
