"""Prediction of a keyframe by one hypothesis."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration, OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.models.correlated_errors import ErrorTransition, PredictedErrors
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.models.noise.noise_settings import errors_under
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.sensed_region import SensedRegion
from semantic_slam.inference.models.spatial.camera import Camera
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.moving.moving_objects import PredictedMovers, predicted_movers
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.open_world.prediction.nearby import local_around, near_objects, objects_in_reach
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.prediction.predicted_robot import PredictedRobot
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.open_world.second_boxes import second_boxes
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.smoothing.local_map import LocalMap
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.states.propagated_errors import PropagatedErrors
from semantic_slam.inference.states.tracked_objects import HypothesisObjects
from semantic_slam.inference.world.departures import Departures


@dataclass(frozen=True, kw_only=True)
class FrameInput:
    """What a keyframe gives to the prediction; D detections, with the covariances that the component assumes."""

    motion: Motion  # since the previous keyframe
    detections: Sequence[Any]  # D
    sensed: SensedRegion | Camera | None = None  # the sensor's region where it is learned, or in space its camera
    stamp_ns: int = 0  # used where objects depart or move
    labels: Sequence[str] = ()  # (D,) used where objects move


class Predictor:
    """Makes predictions; a pure function of the component and the keyframe."""

    def __init__(
        self,
        model: ObservationModel,
        settings: OpenWorldConfiguration,
        errors: DetectionErrorsConfiguration,
        moving: Moving | None = None,
        departures: Departures | None = None,
    ):
        self.model, self.settings, self.errors = model, settings, errors
        self._moving, self._departures = moving or Moving(), departures or Departures(settings)
        self._moving_under = {self._moving.errors: self._moving}

    def predict(
        self,
        component: Component,
        frame: FrameInput,
        *,
        named: Index | None = None,
        wanted: Collection[int] = (),
    ) -> Prediction:
        """The prediction, with the noise that the component assumes. Raises LostComponentError.

        ``named``: (M,) rows of the objects that the detections may be of; None: of those near them, and of those with
        ``wanted`` ids.
        """
        detections = frame.detections
        predicted = PredictedRobot.of(component, frame.motion)
        robot = predicted.state
        geometry = geometry_of(component.spaces)
        region = geometry.region(self.settings).reaching(frame.sensed).read_by(component.noise_settings)
        births = geometry.births(self.model, detections, robot, region)
        reach = self._in_reach(component, region, robot, predicted.covariance)
        near, beyond = self._near(predicted, births, detections, reach, named, wanted)
        ahead = geometry.ahead(region, tracked_states(component).states, robot, reach)
        local, shift = predicted.moved(local_around(component, robot, near, ahead))
        propagated = self._earlier_errors(predicted)
        local, errors = self._with_errors(component, local, propagated, near, detections)
        belief = predicted.with_objects(near, local, shift)
        objects = objects_in_reach(component, predicted, reach, near, belief)
        detected = _detected_in_reach(component, region, reach, objects)
        population, movers = self._left(component, frame.stamp_ns)
        num_second, second = second_boxes(self.settings, component, population.existence_given, births, detected)
        expected, intensity, existence = geometry.expected_births(
            self.settings, component, region, robot, births, detections, second
        )
        return Prediction(
            movers=self._movers(component, movers, predicted, region, frame),
            component=component,
            population=population,
            near=near,
            predicted=belief,
            local=local,
            errors=errors,
            propagated_errors=propagated,
            births=births,
            rates=component.objects.rates,
            log_intensity=intensity,
            birth_existence=existence,
            expected_births=expected + num_second,
            log_beyond=beyond,
            log_level=predicted.log_level,
            in_reach=reach,
            objects=objects,
            detected=detected,
            detections=detections,
            region=region,
        )

    def _near(
        self,
        predicted: PredictedRobot,
        births: list[Birth],
        detections: Sequence[Any],
        reach: Index,
        named: Index | None,
        wanted: Collection[int],
    ) -> tuple[Index, Array]:
        """(M,) rows of objects that a detection may belong to, and (D,) bounds on the evidence of those left out."""
        if named is not None:
            return named, np.full(len(births), -np.inf)
        return near_objects(
            self.settings,
            predicted.component,
            predicted.state,
            predicted.covariance,
            births,
            detections,
            reach,
            wanted,
        )

    def _earlier_errors(self, predicted: PredictedRobot) -> PropagatedErrors | None:
        """The correlated errors of earlier detections after the motion; None: errors are independent."""
        component = predicted.component
        errors = tracked_states(component).errors
        if errors is None:
            return None
        return errors.moved(predicted.noise.control, errors_under(component.noise_settings, self.errors))

    def _with_errors(
        self,
        component: Component,
        local: LocalMap,
        earlier: PropagatedErrors | None,
        near: Index,
        detections: Sequence[Any],
    ) -> tuple[LocalMap, PredictedErrors | None]:
        """The local map with these detections' correlated errors replacing earlier ones; unchanged without any."""
        settings = errors_under(component.noise_settings, self.errors)
        if settings.correlated_share <= 0.0 or not detections:
            return local, None
        ranged = np.array([detection.has_range for detection in detections], dtype=bool)
        transition = ErrorTransition.of(settings, earlier, detections)
        local = local.with_errors(transition.matrix, transition.noise)
        near_rows = local.rows(component.objects.ids[near])
        return local, PredictedErrors(
            transition=transition,
            slopes=transition.white.slopes(ranged),
            covariance=local.covariance[local.errors, local.errors],
            cross=local.covariance[near_rows, local.errors],
        )

    def _left(self, component: Component, stamp_ns: int) -> tuple[HypothesisObjects, Movers | None]:
        """Static and moving objects after departures until ``stamp_ns``; moving objects do not depart."""
        objects, movers = component.objects, component.movers
        per_hour = self._departures.per_hour(objects.ids)
        if objects.gone is None or movers is None or movers.decided.all():
            return objects.left_until(stamp_ns, per_hour), movers
        moving = np.zeros(objects.existence_given.shape)
        moving[objects.rows(movers.ids[~movers.decided])] = movers.moving[~movers.decided]
        population = objects.left_until(stamp_ns, per_hour, moving)
        return population, movers.among(objects, population)

    def _in_reach(self, component: Component, region: Any, robot: Array, spread: Array) -> Index:
        """(N,) rows of objects that may be in the region of a robot with covariance ``spread``."""
        tracked = tracked_states(component)
        rows = component.spaces.robot.position_rows
        sigma = float(largest_sigmas(spread[None, rows, rows])[0])
        margin = self.settings.gate_sigma * np.hypot(sigma, tracked.sigmas)
        reach = np.flatnonzero(
            geometry_of(component.spaces).distances(tracked.states, robot) < region.farthest_m + margin
        )
        if absent := component.elsewhere | component.left_behind:
            reach = reach[~np.isin(component.objects.ids[reach], list(absent))]
        return reach

    def _movers(
        self,
        component: Component,
        movers: Movers | None,
        predicted: PredictedRobot,
        region: SensorRegion,
        frame: FrameInput,
    ) -> PredictedMovers | None:
        """Predicted moving objects; None without any, if no detection may start one."""
        if movers is None or not (len(movers) or self._moving.shares(frame.labels).any()):
            return None
        return predicted_movers(
            self._moving_with(errors_under(component.noise_settings, self._moving.errors)),
            movers,
            predicted.motion(len(self._moving.sensor_sigmas), drifts=bool(frame.detections)),
            frame.stamp_ns,
            region=region,
            rates=component.objects.rates,
            detections=frame.detections,
            labels=frame.labels,
        )

    def _moving_with(self, errors: DetectionErrorsConfiguration) -> Moving:
        """The model of moving objects under these errors of detections, made once for each."""
        if errors not in self._moving_under:
            self._moving_under[errors] = replace(self._moving, errors=errors)
        return self._moving_under[errors]


def _detected_in_reach(component: Component, region: Any, reach: Index, objects: PredictedObjects) -> Array:
    """(O, G) detection probabilities at the prediction, without occlusion; 0 for objects out of reach."""
    rates = component.objects.rates
    sensors, which = rates.sensors
    predicted = geometry_of(component.spaces).predicted_detections(region, sensors, objects)
    detected = np.zeros(component.objects.existence_given.shape)
    detected[reach] = predicted.detected[0][:, which]
    return detected
