"""Retrospective association weights in space.

When a detection arrived, the range of its object was poorly known from rays, and it may have been assigned to a wrong
one. Now that ranges are known, its direction is decisive. Detections a few standard deviations off have a Cauchy tail,
as the path is not exact; what is farther off belongs to another object.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, squared_norms
from semantic_slam.inference.models.observation import Innovation
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.spatial.looks import looks
from semantic_slam.inference.open_world.spatial.pair_ranges import log_ranges_of
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight

FAR_SIGMAS = 2.0
"""Number of standard deviations beyond which each further one costs another nat, as a false alarm becomes likelier."""


@dataclass(frozen=True, kw_only=True)
class SpatialHindsight(Hindsight):
    """Hindsight for a camera in space."""

    @cached_property
    def in_view(self) -> Flags:
        found = np.zeros((len(self.ids), len(self.steps)), dtype=bool)
        points = self.problem.spaces.landmark.position(self.places)
        numbers, times, _ = looks(self._region, self.path, points, points)
        found[numbers, times] = True
        return found

    def log_density(self, innovation: Innovation, sizes: Index) -> Array:
        squared = squared_norms(innovation.whitened)
        beyond = np.maximum(np.sqrt(squared) - FAR_SIGMAS, 0.0)
        return np.asarray(innovation.log_density + 0.5 * squared - 0.5 * (1 + sizes) * np.log1p(squared) - beyond)

    def log_of_none(self, step: Step, robot: Array, owners: Index) -> Array:
        return np.full(len(step.detections), self._log_of_none)

    def log_ranges(self, step: Step, robot: Array) -> tuple[Array, Array]:
        slopes = self.problem.spaces.landmark.position_slopes(self.places)
        spreads = slopes @ self.spreads @ np.swapaxes(slopes, 1, 2)
        return log_ranges_of(self.problem.spaces, step.detections, robot, self.places, spreads)

    @cached_property
    def _region(self) -> SpatialRegion:
        return SpatialRegion.of(self.problem.open_world).reaching(self.steps[-1].camera)

    @cached_property
    def _log_of_none(self) -> float:
        rates, region, settings = self.component.objects.rates, self._region, self.problem.open_world
        born = settings.least_undetected_share * rates.probability * rates.birth_density
        intensity = float(rates.average(born + rates.clutter_per_frame / region.volume_m3))
        return float(np.log(intensity) + np.log((region.max_range_m**3 - region.min_range_m**3) / 3.0))
