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
        there = self._there * np.exp(self.log_if_there)
        missed = np.log(np.maximum(there + 1.0 - self._there, LEAST_PROBABILITY))
        return np.asarray(np.where(self._again, np.log(self._there) + self.log_if_there, missed))

    @cached_property
    def existence(self) -> Array:
        """(O, G) existence probability at the end: certain of an object that was detected again."""
        there = self._there * np.exp(self.log_if_there)
        return np.where(self._again, 1.0, there / np.maximum(there + 1.0 - self._there, LEAST_PROBABILITY))

    @cached_property
    def _there(self) -> Array:
        """(O, G) existence probability before the stretch or, of an object first detected in it, at its birth.

        Before the stretch it is 1 for an object detected twice, else that of a birth on unseen ground.
        """
        density = self.rates.birth_density * self.rates.probability
        once = birth(density, self._clutter)[1]
        before = self.seen[:, : self.begin].sum(axis=1)
        found = np.where((before > 1)[:, None], 1.0, once)
        for rows, intensities, _ in self._born:
            found[rows] = birth(intensities, self._clutter)[1]
        return found

    @cached_property
    def _again(self) -> Flags:
        """(O, 1) whether detected in the stretch other than for the first time."""
        in_stretch = self.seen[:, self.begin :].sum(axis=1)
        return np.asarray(in_stretch > (self._starts >= self.begin))[:, None]

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
        total = np.zeros(len(self.rates))
        for _, intensities, expected in self._born:
            total += np.log(birth(intensities, self._clutter)[0]).sum(axis=0) - expected
        return total

    @cached_property
    def _born(self) -> list[tuple[Index, Array, Array]]:
        """Per keyframe of the stretch: rows of objects first detected (n,), intensities there (n, G), expected (G,)."""
        least, found = self.settings.least_undetected_share, []
        for keyframe in range(self.begin, len(self.path)):
            rows = np.flatnonzero(self._starts == keyframe)
            trail, robot = self.path[:keyframe], self.path[keyframe]
            expected, intensities = first_detections(self.region, self.rates, trail, robot, self.places[rows], least)
            found.append((rows, intensities, expected))
        return found

    @property
    def _clutter(self) -> Array:
        """(G,) intensity of false alarms [1/m^2]."""
        return np.asarray(self.rates.clutter_per_frame / self.region.area_m2)
