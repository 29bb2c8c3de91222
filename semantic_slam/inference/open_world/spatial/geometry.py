"""Open-world geometry in space: SE(3) for the robot, R^3 or SE(3) for objects, whose attitude gravity holds."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array, Index, squared_norms
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.observation import SpatialObservation
from semantic_slam.inference.models.spatial.ray import distances, off_axis
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.margins import NOT_DETECTED, Places, with_occlusion
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.open_world.seen_again import SeenAgain
from semantic_slam.inference.open_world.spatial.births import (
    among_shown,
    births_in_space,
    expected_births_in_space,
    shown_by,
)
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.in_view import InViewProbabilities, PredictedDetections
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M, Spaces
from semantic_slam.inference.states.tracked_objects import TrackedStates


@dataclass(frozen=True)
class SpatialGeometry:
    """An :class:`OpenGeometry` whose robots are (7,) poses and whose objects are (3,) points or (7,) poses."""

    spaces: Spaces

    def region(self, settings: OpenWorldConfiguration) -> SpatialRegion:
        return SpatialRegion.of(settings)

    def births(
        self, model: ObservationModel, detections: Sequence[SpatialDetection], robot: Array, region: SpatialRegion
    ) -> list[Birth]:
        assert isinstance(model, SpatialObservation)
        return births_in_space(self.spaces.landmark, model, detections, robot, region)

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

    def predicted_detections(
        self, region: SpatialRegion, rates: DetectionRates, objects: PredictedObjects
    ) -> PredictedDetections:
        places = self._places(region, objects, objects.robot[None], objects.robot_covariance[None])
        overlap, unoccluded = _overlap(region, None, places, objects.in_view.unoccluded, NOT_DETECTED)
        return objects.in_view.predicted(overlap, unoccluded, _chance(rates, places.points), rates.runs)

    def detections_at(
        self,
        region: SpatialRegion,
        rates: DetectionRates,
        objects: PredictedObjects,
        robot: Array,
        covariance: Array,
        step: Step,
        seen: SeenAgain,
    ) -> tuple[PredictedDetections, Array]:
        in_optical_frame = seen._replace(
            points=region.camera.seen(seen.points),
            slopes=seen.slopes @ region.camera.axes,
            detections=among_shown(step.detections)[seen.detections],
        )
        places = self._places(region, objects, robot, covariance)
        in_view, chance = partial(_overlap, region, shown_by(region, step.detections)), partial(_chance, rates)
        return in_optical_frame.predicted(places, objects.in_view, rates.runs, in_view, chance)

    def distances(self, states: Array, robot: Array) -> Array:
        return np.asarray(np.sqrt(squared_norms(self.spaces.landmark.position(states) - robot[:3])))

    def ahead(self, region: SpatialRegion, states: Array, robot: Array, reach: Index) -> Index:
        """Empty: nothing is read ahead where updates are iterated."""
        return reach[:0]

    def moving_along(self, robot: Array, states: Array) -> Array:
        """Positions move along, attitudes stay."""
        landmark = self.spaces.landmark
        _, by_robot, by_point = self.spaces.robot.in_frame(robot, landmark.position(states))
        displaced = -np.linalg.solve(by_point, by_robot)
        return np.asarray(np.swapaxes(landmark.position_slopes(states), 1, 2) @ displaced, dtype=np.float64)

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
        landmark = self.spaces.landmark
        body = self.spaces.robot.turned_back(robot, landmark.position(tracked.states) - robot[:3])
        found = np.empty((len(detections), len(known)))
        for own, born, detection in zip(found, births, detections, strict=True):
            if detection.has_range:
                noise = float(largest_sigmas(born.noise[None, landmark.position_rows, landmark.position_rows])[0])
                errors = np.sqrt(place**2 + (turn * detection.range_m) ** 2 + known + noise**2)
                own[:] = self.distances(tracked.states, born.prior.mean) / errors
            else:
                seen = body - detection.origin
                away = distances(seen)
                across = (place**2 + known) / away**2
                turned = turn * np.maximum(distances(body) / away, 1.0)  # about the body, which is not the camera
                own[:] = off_axis(seen, detection.ray) / np.sqrt(detection.ray_variance + turned**2 + across)
        return found

    def _places(self, region: SpatialRegion, objects: PredictedObjects, robot: Array, covariance: Array) -> Places:
        """Objects in the optical frame at modes ``robot`` (K, 7) with (K, 6, 6); covariances to first order."""
        shift = self.spaces.robot.local(objects.robot, robot)
        moved = self.spaces.landmark.retract(objects.objects, np.einsum("nij,kj->kni", objects.gain, shift))
        relative = self.spaces.relative_position(robot[:, None], moved)
        together = relative.by_robot + relative.by_landmark @ objects.gain
        spread = together @ covariance[:, None] @ np.swapaxes(together, -1, -2)
        by_remainder = relative.by_landmark @ objects.remainder @ np.swapaxes(relative.by_landmark, -1, -2)
        by_motion = relative.by_robot @ objects.motion_noise @ np.swapaxes(relative.by_robot, -1, -2)
        whole, by_robot, by_motion = region.camera.turned(np.stack([spread + by_remainder, spread, by_motion]))
        mount = region.camera.T_body_camera
        before = se3.between(mount, se3.compose(objects.robot_before, mount))
        return Places(
            points=region.camera.seen(relative.point),
            covariance=whole,
            by_robot=by_robot,
            by_motion=by_motion,
            turn=so3.matrix(before[3:]),
            shift=before[:3],
        )


def _chance(rates: DetectionRates, points: Array) -> Array:
    """(..., G) detection probabilities of objects in view, by their expected places (..., 3)."""
    return np.asarray(rates.probability * rates.fall_off(np.sqrt(_squared_distances(points))))


def _squared_distances(points: Array) -> Array:
    return np.asarray(np.maximum(squared_norms(points), LEAST_DISTANCE_M**2))


def _overlap(
    region: SpatialRegion, shown: tuple[Array, Array] | None, places: Places, before: Array, detected_as: Index
) -> tuple[InViewProbabilities, Array]:
    """Probabilities (...,) to be in view for objects that nothing occluded ``before``, and that nothing does now.

    ``shown``: the detections of the keyframe, see :func:`shown_by`; None: nothing is known to occlude. ``detected_as``
    (...,): which of them are the objects' own, which do not hide them; -1 for none.
    """
    overlap, lasting = places.overlap(region.margins)
    unoccluded, of_shown = np.ones(places.points.shape[:-1]), 0.0
    if shown is not None:
        unoccluded = region.not_occluded(places.points, places.covariance, *shown, detected_as)
        unoccluded = unoccluded * region.seen_before_surfaces(places.points, places.covariance)
        of_shown = float(shown[1][:, 1].mean()) if len(shown[1]) else 0.0
    if region.occluder_radius_m > 0.0:
        across = 0.5 * np.trace(places.covariance, axis1=-2, axis2=-1) / _squared_distances(places.points)
        lasts = lasting[1:].min(axis=0) * places.lasting_sight(across, of_shown)
        overlap = with_occlusion(overlap, before, unoccluded, lasts)
    return overlap, unoccluded


def _sigmas(spread: Array) -> tuple[float, float]:
    """Largest standard deviations of a robot's attitude [rad] and position [m]."""
    turn, place = (float(largest_sigmas(spread[None, own, own])[0]) for own in (se3.ROTATION, se3.TRANSLATION))
    return turn, place
