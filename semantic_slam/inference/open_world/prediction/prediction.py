"""The prediction of one hypothesis for a keyframe: the robot, candidate objects of detections, and births."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.gating import PairDensities
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.correlated_errors import PredictedErrors, share_of
from semantic_slam.inference.models.step import AssociatedDetection
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.existence import LEAST_DETECTION_SHARE, LEAST_PROBABILITY
from semantic_slam.inference.open_world.moving.moving_objects import PredictedMovers
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.smoothing.local_map import LocalDetection, LocalMap, LocalStart
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.observers import Observers
from semantic_slam.inference.states.propagated_errors import PropagatedErrors
from semantic_slam.inference.states.tracked_objects import HypothesisObjects


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """One parent's prediction: M objects near the detections, N within reach of the sensor."""

    component: Component
    population: HypothesisObjects  # its objects, with departures until now
    near: Index  # (M,) rows of the population whose covariance with the robot is known
    predicted: PredictedBelief  # robot and near objects
    local: LocalMap  # predicted; holds all near objects
    errors: PredictedErrors | None  # of the detections, where they are correlated
    propagated_errors: PropagatedErrors | None  # of earlier detections, after the motion
    births: list[Birth]  # D
    rates: DetectionRates  # G settings, on which all below is conditioned
    log_intensity: Array  # (D, G) [1/m^2] or, for a bearing alone, in the region
    birth_existence: Array  # (D, G)
    expected_births: Array  # (G,) first detections and duplicate boxes
    log_beyond: Array  # (D,) bound on the evidence of near objects left out
    in_reach: Index  # (N,) rows of the population that may be in the region
    objects: PredictedObjects  # the N objects in reach
    detections: Sequence[Any]  # D, with the covariances that the hypothesis assumes
    region: Any  # the type depends on the geometry
    detected: Array  # (O, G) detection probabilities at the prediction, without occlusion
    movers: PredictedMovers | None = None  # objects that move or may move; None: nothing moves
    log_level: float = 0.0  # log density of the gravity measurement, if any

    @cached_property
    def stands(self) -> Array:
        """(O, G) probability that an object stands still, if it exists."""
        stands = np.ones(self.existence.shape)
        if self.movers is not None:
            stands[self.undecided] -= self.movers.movers.moving[~self.movers.movers.decided]
        return stands

    @property
    def least_detected(self) -> Array:
        """(G,) lower bounds on the detection probability of an object that was in fact detected."""
        return LEAST_DETECTION_SHARE * self.rates.probability

    @cached_property
    def log_born(self) -> Array:
        """(D, G) log ratio of the evidence as a first detection to that under the stand-in prior."""
        areas = np.array([birth.log_area - birth.log_stand_in for birth in self.births])
        return np.asarray(self.log_intensity + areas[:, None])

    @cached_property
    def log_false_alarm(self) -> Array:
        """(D, G) log density of the detections as false alarms."""
        areas = np.array([birth.log_area for birth in self.births])
        share = np.maximum(1.0 - self.birth_existence, LEAST_PROBABILITY)
        return np.asarray(self.log_intensity + areas[:, None] + np.log(share))

    @cached_property
    def undecided(self) -> Index:
        """(u,) rows of the objects that may move (undecided), in the order of their ids."""
        assert self.movers is not None
        movers = self.movers.movers
        return self.component.objects.rows(movers.ids[~movers.decided])

    def detected_at_all(self, detected: Array) -> Array:
        """(K, O, G) detection probabilities averaged over standing still or moving, from those if standing still."""
        if self.movers is None:
            return detected
        mixed = detected * self.stands
        movers = self.movers.movers
        mixed[:, self.undecided] += (movers.moving * self.movers.detected)[~movers.decided]
        return mixed

    @property
    def sensor(self) -> tuple[Array, Array]:
        """(d,) expected constant sensor errors, and (d, r + d) covariance with the robot and among each other."""
        errors = self.propagated_errors if self.errors is None else self.errors.transition
        count = 0 if errors is None else errors.by_sensor.shape[1]
        if errors is None or not count:
            return np.zeros(0), np.zeros((0, self.local.layout.robot))
        rows = np.arange(self.local.errors.stop - count, self.local.errors.stop)
        columns = np.concatenate([np.arange(self.local.layout.robot), rows])
        return errors.mean[-count:], self.local.covariance[rows[:, None], columns]

    @property
    def observer(self) -> Observers:
        """The robot in the plane and the constant errors of its sensor."""
        robot, covariance = self.predicted.mean[0, :1, :3], self.predicted.covariance[:1, :3, :3]
        mean, spread = self.sensor
        return Observers.of(robot, covariance, mean[None], spread[None])

    @property
    def existence(self) -> Array:
        """(O, G) existence of the parent's objects before the keyframe."""
        return self.population.existence_given

    @property
    def near_ids(self) -> Index:
        """(M,) ids of the objects near the detections, ascending."""
        return self.component.objects.ids[self.near]

    @property
    def anchors(self) -> Array | None:
        """(M, 3) position from which a near object was first seen along a ray alone, NaN for others; None: all NaN."""
        anchors = tracked_states(self.component).anchors
        return None if anchors is None else anchors[self.near]

    @property
    def mover_ids(self) -> Index:
        """(T,) ids of the objects that move or may move."""
        return np.zeros(0, dtype=int) if self.movers is None else self.movers.movers.ids

    def local_after(
        self, pairs: PairDensities, observed: Sequence[AssociatedDetection], births: Collection[int]
    ) -> LocalMap:
        """The local map updated by what one continuation has ``observed`` of static objects, new ones included."""
        seen, part = [], pairs.part if pairs.at_prediction is None else pairs.at_prediction
        for item in observed:
            if item.object_id not in births:
                at = item.number, int(np.searchsorted(self.near_ids, item.object_id))
                by_errors = self._residual_by_errors(item.number)
                slopes = part.jacobian_robot[at], part.jacobian_object[at], by_errors
                seen.append(LocalDetection(item.object_id, *(slope / item.width for slope in slopes)))
        started = [
            LocalStart(item.object_id, birth.prior.mean, birth.gain, *self._place_by_errors(item.number, birth))
            for item, birth in ((each, self.births[each.number]) for each in observed if each.object_id in births)
        ]
        return self.local.updated(seen).with_new(started)

    def _residual_by_errors(self, number: int) -> Array:
        """(2, q) Jacobian of a detection's whitened residual by the correlated errors."""
        slope = np.zeros((2, self.local.num_errors))
        if self.errors is not None:
            slope[:, 2 * number : 2 * number + 2] = np.diag(self.errors.slopes[number])
        return slope

    def _place_by_errors(self, number: int, born: Birth) -> tuple[Array, Array]:
        """(3, 3) white covariance of a new object's position, and (3, q) its Jacobian by the correlated errors."""
        slope = np.zeros((3, self.local.num_errors))
        if self.errors is None:
            return born.noise, slope
        share = share_of(self.errors.transition.white.settings)
        slope[:, 2 * number : 2 * number + 2] = -np.sqrt(share) * born.by_error
        return born.noise - share * born.by_error @ born.by_error.T, slope
