"""Open-world geometry in space: SE(3) for the robot, R^3 for objects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array, Index, broadcast_copy, squared_norms
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.ray import distances, off_axis
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.open_world.spatial.births import births_in_space, expected_births_in_space, shown_by
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import TrackedStates


@dataclass(frozen=True)
class SpatialGeometry:
    """An :class:`OpenGeometry` whose robots are (7,) poses and whose objects are (3,) points."""

    spaces: Spaces

    def region(self, settings: OpenWorldConfiguration) -> SpatialRegion:
        return SpatialRegion.of(settings)

    def births(
        self, model: ObservationModel, detections: Sequence[SpatialDetection], robot: Array, region: SpatialRegion
    ) -> list[Birth]:
        return births_in_space(model, detections, robot, region)

    def expected_births(
        self,
        settings: OpenWorldConfiguration,
        component: Component,
        region: SpatialRegion,
        robot: Array,
        births: list[Birth],
        detections: Sequence[SpatialDetection],
        second: Array,
    ) -> tuple[Array, Array, Array]:
        return expected_births_in_space(settings, component, region, robot, births, detections, second)

    def predicted_detections(self, region: SpatialRegion, rates: DetectionRates, objects: PredictedObjects) -> Array:
        robot, covariance = objects.robot[None], objects.robot_covariance[None]
        seen, spread = self._seen(region, objects, robot, covariance)
        return np.asarray(_by_rates(rates, region.contains(seen, spread), seen)[0])

    def detections_at(
        self,
        region: SpatialRegion,
        rates: DetectionRates,
        objects: PredictedObjects,
        robot: Array,
        covariance: Array,
        step: Step,
    ) -> Array:
        seen, spread = self._seen(region, objects, robot, covariance)
        inside = region.contains(seen, spread)
        return _by_rates(rates, inside * region.not_occluded(seen, spread, *shown_by(region, step.detections)), seen)

    def distances(self, states: Array, robot: Array) -> Array:
        return np.asarray(np.sqrt(squared_norms(states - robot[:3])))

    def ahead(self, region: SpatialRegion, states: Array, robot: Array, reach: Index) -> Index:
        """Empty: nothing is read ahead where updates are iterated."""
        return reach[:0]

    def moving_along(self, robot: Array, states: Array) -> Array:
        relative = self.spaces.relative_position(broadcast_copy(robot, (len(states), len(robot))), states)
        return np.asarray(-np.linalg.solve(relative.by_landmark, relative.by_robot), dtype=np.float64)

    def sigmas_away(
        self,
        tracked: TrackedStates,
        robot: Array,
        spread: Array,
        births: list[Birth],
        detections: Sequence[SpatialDetection],
    ) -> Array:
        """Standard deviations of the direction alone where a detection has no range."""
        (turn, place), known = _sigmas(spread), tracked.sigmas**2
        body = self.spaces.robot.turned_back(robot, tracked.states - robot[:3])
        found = np.empty((len(detections), len(known)))
        for own, born, detection in zip(found, births, detections, strict=True):
            if detection.has_range:
                noise = float(largest_sigmas(born.noise[None])[0])
                errors = np.sqrt(place**2 + (turn * detection.range_m) ** 2 + known + noise**2)
                own[:] = self.distances(tracked.states, born.prior.mean) / errors
            else:
                seen = body - detection.origin
                away = distances(seen)
                across = (place**2 + known) / away**2
                turned = turn * np.maximum(distances(body) / away, 1.0)  # about the body, which is not the camera
                own[:] = off_axis(seen, detection.ray) / np.sqrt(detection.ray_variance + turned**2 + across)
        return found

    def _seen(
        self, region: SpatialRegion, objects: PredictedObjects, robot: Array, covariance: Array
    ) -> tuple[Array, Array]:
        """(K, N, 3) objects in the optical frame at modes ``robot`` (K, 7) with (K, 6, 6), and their covariances.

        The latter are (K, N, 3, 3), to first order.
        """
        shift = self.spaces.robot.local(objects.robot, robot)
        moved = objects.objects + np.einsum("nij,kj->kni", objects.gain, shift)
        robots = broadcast_copy(robot[:, None], (*moved.shape[:-1], robot.shape[-1]))
        relative = self.spaces.relative_position(robots, moved)
        together = relative.by_robot + relative.by_landmark @ objects.gain
        spread = together @ covariance[:, None] @ np.swapaxes(together, -1, -2)
        spread += relative.by_landmark @ objects.remainder @ np.swapaxes(relative.by_landmark, -1, -2)
        return region.camera.seen(relative.point), region.camera.turned(spread)


def _by_rates(rates: DetectionRates, inside: Array, seen: Array) -> Array:
    """(..., G) detection probabilities of objects at (..., 3) in the optical frame, (...,) of which lies inside."""
    distance = np.sqrt(squared_norms(seen))
    return np.asarray(inside[..., None] * rates.probability * rates.fall_off(distance))


def _sigmas(spread: Array) -> tuple[float, float]:
    """Largest standard deviations of a robot's attitude [rad] and position [m]."""
    turn, place = (float(largest_sigmas(spread[None, own, own])[0]) for own in (se3.ROTATION, se3.TRANSLATION))
    return turn, place
