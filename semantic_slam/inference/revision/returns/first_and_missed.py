"""Rough likelihood of first detections, later ones and misses of a history, over sensor and world settings.

The path is taken as known and objects as existing, which suffices to select histories to replay.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.planar.region import SensorRegion, sensor_region
from semantic_slam.inference.open_world.planar.sightings import Sightings
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.detection_rates import DetectionRates


@dataclass(frozen=True, kw_only=True)
class FirstAndMissed:
    """T keyframes, G settings of sensor and world, P of which differ in detection rates."""

    rates: DetectionRates  # G, before the drive
    regions: Sequence[SensorRegion]  # T
    expected_births: Array  # (G,) first detections over all keyframes
    num_mapped: int  # number of map objects, which come first and have no birth

    @classmethod
    def of(
        cls,
        settings: OpenWorldConfiguration,
        steps: Sequence[Step],
        component: Component,
        expected_births: float,
        num_mapped: int,
    ) -> Self:
        """``expected_births`` are those of the history of ``component``, averaged over its settings."""
        rates, region = DetectionRates.of(settings), sensor_region(settings).read_by(component.noise_settings)
        density = rates.birth_density / max(component.objects.rates.moments("birth_density")[0], 1e-9)
        return cls(
            rates=rates,
            regions=[region.reaching(step.sensed) for step in steps],
            expected_births=expected_births * density,
            num_mapped=num_mapped,
        )

    @cached_property
    def log_intensities(self) -> Array:
        """(G,) log intensities of first detections [1/m^2]."""
        clutter = self.rates.clutter_per_frame / self.regions[-1].area_m2
        return np.asarray(np.log(self.rates.probability * self.rates.birth_density + clutter))

    def by_object(self, path: Array, places: Array, seen: Flags, numbers: Index | None = None) -> Array:
        """(N, P) log likelihoods of later detections and misses of objects at ``places`` (N, 2), ``seen`` (N, T).

        ``path`` (1 + T, 3) starts with the pose before the first keyframe. ``numbers`` (N,) of the objects; None: all
        in order.
        """
        sightings = Sightings(path=path[1:], regions=self.regions, sensors=self.rates.sensors[0])
        rows = np.arange(len(places)) if numbers is None else numbers
        first = np.where(rows < self.num_mapped, -1, seen.argmax(axis=1))
        return np.asarray(sightings.log_likelihoods(sightings.in_view(places), seen, first))

    def log_probability(self, births: int, log_likelihoods: Array) -> float:
        """Log probability of so many births, and of later detections and misses (P,), summed over settings."""
        _, which = self.rates.sensors
        false_alarms = len(self.regions) * self.rates.clutter_per_frame
        expected = self.expected_births + false_alarms
        return float(self.rates.explained(births * self.log_intensities - expected + log_likelihoods[which])[0])
