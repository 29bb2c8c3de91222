"""Retrospective association weights in the plane, with duplicate boxes of adjacent things."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.planar.detection_probability import looks
from semantic_slam.inference.open_world.planar.region import SensorRegion, sensor_region
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.second_boxes import second_box_densities
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.smoothing.component import tracked_states


@dataclass(frozen=True, kw_only=True)
class PlanarHindsight(Hindsight):
    """Hindsight for a planar sensor."""

    @cached_property
    def in_view(self) -> Flags:
        found = np.zeros((len(self.ids), len(self.steps)), dtype=bool)
        numbers, times, _ = looks(self._region, self.path, self.places[:, :2], self.places[:, :2])
        found[numbers, times] = True
        return found

    def log_of_none(self, step: Step, robot: Array, owners: Index) -> Array:
        settings, rates = self.problem.open_world, self.component.objects.rates
        births = geometry_of(self.problem.spaces).births(self.problem.model, step.detections, robot, self._region)
        if not births:
            return np.zeros(0)
        born = settings.least_undetected_share * rates.probability * rates.birth_density
        alone = float(rates.average(born + rates.clutter_per_frame / self._region.area_m2))
        landmark, tracked = self.problem.spaces.landmark, tracked_states(self.component)
        second = second_box_densities(settings, landmark, tracked, births)[:, self._rows]
        second = np.where(owners[:, None] == np.arange(len(self.ids)), 0.0, second)  # the object is taken to be none
        intensity = alone + settings.second_box_share * self.detected * second.sum(axis=1)
        ranged = np.array([detection.has_range for detection in step.detections], dtype=bool)
        areas = np.array([own.log_area for own in births])
        return np.asarray(np.log(np.where(ranged, intensity, intensity * self._region.area_m2)) + areas)

    def log_ranges(self, step: Step, robot: Array) -> tuple[Array, Array]:
        """Empty: boxes carry no size evidence in the plane."""
        nothing = np.zeros((len(step.detections), len(self.ids)))
        return nothing, nothing

    @cached_property
    def _region(self) -> SensorRegion:
        region = sensor_region(self.problem.open_world).read_by(self.component.noise_settings)
        return region.reaching(self.steps[-1].sensed)
