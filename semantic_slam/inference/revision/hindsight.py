"""What every detection of a drive in space weighs as one of each object, by the path and the map as they are known now.

When a detection came, rays told hardly how far off its object was, and it may have been taken for another one's. Now
that ranges are known, its direction tells. The path counts as known, so that detections a few standard deviations off
weigh what Cauchy's tail leaves them; tracks of boxes do not count, and the camera counts as mounted as it is now. That
is enough to tell which histories to replay.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, squared_norms
from semantic_slam.inference.models.observation import Innovation
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.spatial.looks import looks
from semantic_slam.inference.open_world.spatial.pair_ranges import log_ranges_of
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.revision.replay import Lineage, Replay, Revised
from semantic_slam.inference.semantics.interface import RanksPairs
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.states.keys import robot_key
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem

HIDES = 0.9
"""Existence from which on an object hides what is behind it, and may be what another one's detections are of."""


@dataclass(frozen=True, kw_only=True)
class Hindsight:
    """A history of T keyframes with N objects, each detection of which is of one of them or of none."""

    problem: Problem
    registry: ObjectRegistry
    steps: Sequence[Step]  # T
    lineage: Lineage  # T
    component: Component  # after these

    @classmethod
    def of(cls, replay: Replay, registry: ObjectRegistry, followed: Revised) -> Self:
        """A history as it was replayed."""
        return cls(
            problem=replay.problem,
            registry=registry,
            steps=replay.steps,
            lineage=followed.lineage,
            component=followed.component,
        )

    @cached_property
    def ids(self) -> Index:
        """(N,) of the objects that exist."""
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
        return [self._weighed(step, robot) for step, robot in zip(self.steps, self._path, strict=True)]

    @cached_property
    def first_seen(self) -> Index:
        """(N,) keyframe of the first detection of each object; T where none is of it."""
        found = np.full(len(self.ids) + 1, len(self.steps))
        for keyframe in reversed(range(len(self.steps))):
            found[self.owners[keyframe]] = keyframe
        return found[:-1]

    @property
    def log_unseen(self) -> float:
        """Log of the least that is left of a birth where the camera has looked before."""
        with np.errstate(divide="ignore"):
            return float(np.log(self.problem.open_world.least_undetected_share))

    @property
    def log_missed(self) -> float:
        """Log probability that what is in view is not detected."""
        return float(np.log1p(-self._detected))

    @cached_property
    def in_view(self) -> Flags:
        """(N, T) at which keyframes each object is in the region, and nothing before it."""
        found = np.zeros((len(self.ids), len(self.steps)), dtype=bool)
        numbers, times, _ = looks(self._region, self._path, self._places, self._places)
        found[numbers, times] = True
        return found

    @cached_property
    def _rows(self) -> Index:
        return self.component.objects.rows(self.ids)

    @cached_property
    def _path(self) -> Array:
        """(T, 7) as smoothed by now."""
        return self.component.states([robot_key(k) for k in range(len(self.steps))])

    @cached_property
    def _places(self) -> Array:
        return np.asarray(tracked_states(self.component).states[self._rows])

    @property
    def _spreads(self) -> Array:
        """(N, 3, 3)."""
        return np.asarray(tracked_states(self.component).covariances[self._rows])

    @cached_property
    def _region(self) -> SpatialRegion:
        return SpatialRegion.of(self.problem.open_world).reaching(self.steps[-1].camera)

    @cached_property
    def _detected(self) -> float:
        """Probability that what is in view is detected."""
        rates = self.component.objects.rates
        return float(rates.average(rates.probability))

    @cached_property
    def _log_of_none(self) -> float:
        """Log weight of a first detection, or of a false alarm, where the camera has looked before."""
        rates, region, settings = self.component.objects.rates, self._region, self.problem.open_world
        born = settings.least_undetected_share * rates.probability * rates.birth_density
        intensity = float(rates.average(born + rates.clutter_per_frame / region.volume_m3))
        return float(np.log(intensity) + np.log((region.max_range_m**3 - region.min_range_m**3) / 3.0))

    def _weighed(self, step: Step, robot: Array) -> Array:
        found = np.full((len(step.detections), len(self.ids) + 1), self._log_of_none)
        if found.size and len(self.ids):
            found[:, :-1] = self._by_place(step, robot) + np.log(self._detected)
        return found + self._by_word(step, robot)

    def _by_place(self, step: Step, robot: Array) -> Array:
        """(D, N) by direction, and range where that is told."""
        model, count = self.problem.model, len(self.ids)
        numbers, columns = np.divmod(np.arange(len(step.detections) * count), count)
        robots = np.broadcast_to(robot, (len(numbers), len(robot)))
        part = model.geometry(model.collect(step.detections).take(numbers), robots, self._places[columns])
        innovation = Innovation.of(part, part.jacobian_object, self._spreads[columns])
        squared, size = squared_norms(innovation.whitened), part.measured.sum(axis=1)
        told = innovation.log_density + 0.5 * squared - 0.5 * (1 + size) * np.log1p(squared)
        return np.asarray(told.reshape(-1, count))

    def _by_word(self, step: Step, robot: Array) -> Array:
        """(D, N + 1) by what the detector calls them."""
        semantics, found = self.problem.semantics, np.zeros((len(step.detections), len(self.ids) + 1))
        if step.words is None or not isinstance(semantics, RanksPairs) or not found.size:
            return found
        numbers = self.ids.tolist()
        log_prior = self.registry.log_class_prior_of([*numbers, self.registry.first_new_id(step.index)])
        views = [self.component.views.get(n) for n in numbers]
        spaces = self.problem.spaces
        ranges = log_ranges_of(spaces, step.detections, robot, self._places, self._spreads)
        return semantics.log_pairs(replace(step, names=("",) * len(step.names)), views, log_prior, *ranges)
