"""What detections in space weigh in hindsight.

When a detection came, rays told hardly how far off its object was, and it may have been taken for another one's. Now
that ranges are known, its direction tells. Detections that are a few standard deviations off weigh what Cauchy's tail
leaves them, for the path is not quite known; what is farther off is another thing.
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

FAR_SIGMAS = 8.0
"""Standard deviations from which on each more costs a nat besides."""


@dataclass(frozen=True, kw_only=True)
class SpatialHindsight(Hindsight):
    """What a camera that is anywhere tells in hindsight."""

    @cached_property
    def in_view(self) -> Flags:
        found = np.zeros((len(self.ids), len(self.steps)), dtype=bool)
        numbers, times, _ = looks(self._region, self.path, self.places, self.places)
        found[numbers, times] = True
        return found

    def log_density(self, innovation: Innovation, sizes: Index) -> Array:
        squared = squared_norms(innovation.whitened)
        beyond = np.maximum(np.sqrt(squared) - FAR_SIGMAS, 0.0)
        return np.asarray(innovation.log_density + 0.5 * squared - 0.5 * (1 + sizes) * np.log1p(squared) - beyond)

    def log_of_none(self, step: Step, robot: Array, owners: Index) -> Array:
        return np.full(len(step.detections), self._log_of_none)

    def log_ranges(self, step: Step, robot: Array) -> tuple[Array, Array]:
        return log_ranges_of(self.problem.spaces, step.detections, robot, self.places, self.spreads)

    @cached_property
    def _region(self) -> SpatialRegion:
        return SpatialRegion.of(self.problem.open_world).reaching(self.steps[-1].camera)

    @cached_property
    def _log_of_none(self) -> float:
        rates, region, settings = self.component.objects.rates, self._region, self.problem.open_world
        born = settings.least_undetected_share * rates.probability * rates.birth_density
        intensity = float(rates.average(born + rates.clutter_per_frame / region.volume_m3))
        return float(np.log(intensity) + np.log((region.max_range_m**3 - region.min_range_m**3) / 3.0))
