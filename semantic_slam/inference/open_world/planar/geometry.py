"""Open-world geometry in the plane: SE(2) for robot and objects."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Index, broadcast_copy
from semantic_slam.geometry.moments import position_sigmas
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.planar.frames import object_in_body
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.planar.births import births_of
from semantic_slam.inference.open_world.planar.detection_probability import (
    Occluders,
    detection_probabilities,
    predicted_detection_probabilities,
)
from semantic_slam.inference.open_world.planar.expected_births import expected_births
from semantic_slam.inference.open_world.planar.region import SensorRegion, sensor_region
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.open_world.seen_again import SeenAgain
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.in_view import PredictedDetections
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M
from semantic_slam.inference.states.tracked_objects import TrackedStates

MOST_AHEAD = 80
"""Most objects ahead of the sensor in a local map: any of them may be detected before it is read again."""
AHEAD_RAD = 0.2
"""Margin beyond the region's bearings, into which a turn of the robot may bring objects."""


class PlanarGeometry:
    """An :class:`OpenGeometry` whose states are x, y, yaw."""

    def region(self, settings: OpenWorldConfiguration) -> SensorRegion:
        return sensor_region(settings)

    def births(
        self, model: ObservationModel, detections: Sequence[Any], robot: Array, region: SensorRegion
    ) -> list[Birth]:
        return births_of(model, detections, robot, region)

    def expected_births(
        self,
        settings: OpenWorldConfiguration,
        component: Component,
        region: SensorRegion,
        robot: Array,
        births: list[Birth],
        detections: Sequence[Any],
        second: Array,
    ) -> tuple[Array, Array, Array]:
        return expected_births(settings, component, region, robot, births, detections, second)

    def predicted_detections(
        self, region: SensorRegion, rates: DetectionRates, objects: PredictedObjects
    ) -> PredictedDetections:
        return predicted_detection_probabilities(region, rates, objects)

    def detections_at(
        self,
        region: SensorRegion,
        rates: DetectionRates,
        objects: PredictedObjects,
        robot: Array,
        covariance: Array,
        step: Step,
        seen: SeenAgain,
    ) -> tuple[PredictedDetections, Array]:
        shown = Occluders.of(step.detections, step.free_range_scan)
        return detection_probabilities(region, rates, objects, robot, covariance, shown, seen)

    def distances(self, states: Array, robot: Array) -> Array:
        return np.asarray(np.hypot(states[:, 0] - robot[0], states[:, 1] - robot[1]))

    def ahead(self, region: SensorRegion, states: Array, robot: Array, reach: Index) -> Index:
        apart = states[reach, :2] - robot[:2]
        off = region.off_centre(np.arctan2(apart[:, 1], apart[:, 0]) - robot[2])
        seen = reach[np.abs(off) <= 0.5 * region.field_of_view_rad + AHEAD_RAD]
        return seen[np.argsort(self.distances(states[seen], robot), kind="stable")[:MOST_AHEAD]]

    def moving_along(self, robot: Array, states: Array) -> Array:
        return se2.adjoint(se2.between(states, broadcast_copy(robot, states.shape)))

    def sigmas_away(
        self, tracked: TrackedStates, robot: Array, spread: Array, births: list[Birth], detections: Sequence[Any]
    ) -> Array:
        pairs = zip(births, detections, strict=True)
        return np.array([self._sigmas_away(tracked, robot, spread, *pair) for pair in pairs])

    def _sigmas_away(self, tracked: TrackedStates, robot: Array, spread: Array, born: Birth, detection: Any) -> Array:
        """(O,) distances in sigmas from one detection; of the direction alone where it has no range."""
        sigma = float(position_sigmas(spread[None])[0])
        if detection.has_range:
            swing, noise = spread[2, 2] * detection.range_m**2, float(position_sigmas(born.noise[None])[0])
            errors = np.sqrt(sigma**2 + swing + tracked.sigmas**2 + noise**2)
            return np.asarray(self.distances(tracked.states, born.prior.mean) / errors)
        body = object_in_body(broadcast_copy(robot, tracked.states.shape), tracked.states) - detection.origin
        distance, bearing = np.hypot(*body.T), np.arctan2(body[:, 1], body[:, 0])
        across = (sigma**2 + tracked.sigmas**2) / np.maximum(distance, LEAST_DISTANCE_M) ** 2
        turn = np.abs(wrap_angle(bearing - detection.bearing_rad))
        return np.asarray(turn / np.sqrt(detection.covariance[1, 1] + spread[2, 2] + across))
