"""Log likelihoods of first detections, later detections and misses over a stretch of a drive, at estimated places."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.open_world.existence import LEAST_PROBABILITY, birth
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.planar.sightings import Sightings
from semantic_slam.inference.open_world.planar.unseen_ground import first_detections
from semantic_slam.inference.states.detection_rates import DetectionRates

BEYOND_M = 1.0
"""Margin [m] beyond the sensor's reach within which objects count as possibly in view."""


@dataclass(frozen=True, kw_only=True)
class StretchAccount:
    """The account of one history from keyframe ``begin`` on; O objects, G settings of sensor and world."""

    settings: OpenWorldConfiguration
    rates: DetectionRates  # G
    region: SensorRegion  # as known at the end
    path: Array  # (T, 3) robot at each keyframe
    begin: int
    ids: Index  # (O,) ascending
    places: Array  # (O, 2) metres
    seen: Flags  # (O, T) whether detected in each keyframe

    @property
    def log_likelihoods(self) -> Array:
        """(G,) log likelihoods of all births, detections and misses of the stretch."""
        return np.asarray(self.by_object.sum(axis=0) + self._log_born)

    @cached_property
    def last_seen(self) -> Index:
        """(O,) keyframe of the last detection; -1 without any."""
        times = np.arange(self.seen.shape[1])
        return np.asarray(np.where(self.seen, times, -1).max(axis=1, initial=-1))

    @cached_property
    def log_if_there(self) -> Array:
        """(O, G) log likelihoods of later detections and misses, if the object exists; 0 where it is never in view."""
        found = np.zeros((len(self.places), len(self.rates)))
        near = np.flatnonzero(self._near)
        if not len(near):
            return found
        sensors, which = self.rates.sensors
        now = self.seen[near, self.begin :]
        first = np.where(self._starts[near] < self.begin, -1, now.argmax(axis=1))
        path = self.path[self.begin :]
        sightings = Sightings(path=path, regions=[self.region] * len(path), sensors=sensors)
        found[near] = sightings.log_likelihoods(sightings.in_view(self.places[near]), now, first)[:, which]
        return found

    @cached_property
    def by_object(self) -> Array:
        """(O, G) log likelihoods of later detections and misses, with the object's existence integrated out."""
        there, now = self._there, np.any(self.seen[:, self.begin :], axis=1, keepdims=True)
        missed = np.log(np.maximum(there * np.exp(self.log_if_there) + 1.0 - there, LEAST_PROBABILITY))
        return np.asarray(np.where(now, np.log(there) + self.log_if_there, missed))

    @cached_property
    def _there(self) -> Array:
        """(O, G) existence probability: 1 for an object seen twice or started in the stretch, else that of a birth."""
        density = self.rates.birth_density * self.rates.probability
        once = birth(density, self.rates.clutter_per_frame / self.region.area_m2)[1]
        sure = (self.seen.sum(axis=1) > 1) | (self._starts >= self.begin)
        return np.where(sure[:, None], 1.0, once)

    @cached_property
    def _starts(self) -> Index:
        return np.asarray(self.seen.argmax(axis=1))

    @cached_property
    def _near(self) -> Flags:
        """(O,) whether the robot comes near an object, or sees it, in the stretch."""
        away = self.places[:, None] - self.path[self.begin :, :2]
        reach = self.region.farthest_m + BEYOND_M
        near = (np.hypot(away[..., 0], away[..., 1]) < reach).any(axis=1)
        return np.asarray(near | self.seen[:, self.begin :].any(axis=1))

    @property
    def _log_born(self) -> Array:
        """(G,) log likelihood of the first detections in the stretch (births): their number and their places."""
        total, least = np.zeros(len(self.rates)), self.settings.least_undetected_share
        clutter = self.rates.clutter_per_frame / self.region.area_m2
        for keyframe in range(self.begin, len(self.path)):
            own = self.places[self._starts == keyframe]
            trail, robot = self.path[:keyframe], self.path[keyframe]
            expected, found = first_detections(self.region, self.rates, trail, robot, own, least)
            total += np.log(birth(found, clutter)[0]).sum(axis=0) - expected
        return total
