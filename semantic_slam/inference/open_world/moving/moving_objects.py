"""Moving objects in a keyframe of one hypothesis: prediction, association densities, and update.

They are not variables of the smoother. A detection of one is weighed with robot, constant sensor errors and object
integrated out, robot and sensor errors being known from all that stands still; the object is updated given these, and
does not update them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, broadcast_copy
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.open_world.existence import log_miss
from semantic_slam.inference.open_world.moving.placed_detections import PlacedDetections
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.movers import STATE, Movers
from semantic_slam.inference.states.observers import Observers

LOST_M = 5.0
"""Standard deviation [m] of its position, under every likely speed, above which a moving object is not recognised."""
LOG_LEAST_SPEED = float(np.log(0.01))
"""Log probability below which a speed is ignored there."""
HEADING_VARIANCE = 3.1**2
"""Variance [rad^2] of the heading of a moving object, which is unknown."""


@dataclass(frozen=True, kw_only=True)
class PredictedMovers:
    """T moving objects predicted for D detections, relative to the predicted robot pose."""

    model: Moving
    movers: Movers
    detections: PlacedDetections
    detected_by_speed: Array  # (T, S, G) detection probabilities, if they exist and move
    shares: Array  # (D,) probability that what a detection would start moves
    recognised: Flags  # (T,) whether detections can be associated with them
    rates: DetectionRates

    def __len__(self) -> int:
        return len(self.movers)

    def log_densities(self, rows: Index, numbers: Index, observers: Observers) -> tuple[Array, Array]:
        """(N,) log densities per metre and radian of detections ``numbers`` (N,) as of the objects in ``rows`` (N,).

        Also (N,) their Mahalanobis distances under the best fitting speed. There are N ``observers``.
        """
        residual, by_state, by_robot = self._linearised(rows, numbers, observers)
        innovation = by_robot @ observers.covariances[:, None] @ np.swapaxes(by_robot, -1, -2)
        innovation = innovation + by_state @ self.movers.spreads[rows] @ np.swapaxes(by_state, -1, -2)
        innovation = innovation + self._white(numbers)
        squared, log_determinant = _squared(residual, innovation)
        by_speed = -np.log(2.0 * np.pi) - 0.5 * (squared + log_determinant) + self.movers.log_speeds[rows]
        density = np.logaddexp.reduce(by_speed, axis=1) + self.detections.log_area[numbers]
        return density, np.sqrt(squared.min(axis=1))

    def pairs(self, observer: Observers) -> tuple[Array, Array]:
        """(D, T) log densities and distances for the one predicted observer; infinite distance: not recognisable."""
        numbers, rows = np.nonzero(self.detections.has_range[:, None] & self.recognised)
        found = self.log_densities(rows, numbers, observer.take(np.zeros(len(rows), dtype=int)))
        density = np.full((len(self.shares), len(self)), -np.inf)
        distance = np.full(density.shape, np.inf)
        density[numbers, rows], distance[numbers, rows] = found
        return density, distance

    @cached_property
    def detected(self) -> Array:
        """(T, G) detection probabilities if they exist and move, averaged over speeds."""
        return np.asarray(np.einsum("ts,tsg->tg", np.exp(self.movers.log_speeds), self.detected_by_speed))

    def log_speeds_missed(self, rates: DetectionRates, kept: Flags | None) -> Array:
        """(T, S) log probabilities of the speeds after a miss: a fast object may be out of view.

        Under ``rates`` as known afterwards, of which those ``kept`` (G,) are left; None: all.
        """
        detected = self.detected_by_speed if kept is None else self.detected_by_speed[..., kept]
        with np.errstate(divide="ignore"):
            log_speeds = self.movers.log_speeds + np.log(rates.average(1.0 - detected))
        return np.asarray(log_speeds - np.logaddexp.reduce(log_speeds, axis=1, keepdims=True))

    @cached_property
    def log_missed(self) -> Array:
        """(T, G) log probabilities of missing objects decided to move; 0 for the others."""
        own = self.movers
        return np.asarray(np.where(own.decided[:, None], log_miss(own.existence, self.detected), 0.0))

    def log_detected(self, least: Array, log_missed: Array, undecided: Index) -> Array:
        """(..., T, G) log ratio of detecting each as a moving object to missing it.

        Detection probabilities are not below ``least`` (G,). ``log_missed`` (..., O, G) are those of misses of static
        objects, which include the ``undecided`` (u,) ones.
        """
        own = self.movers
        against = broadcast_copy(self.log_missed, (*log_missed.shape[:-2], *self.log_missed.shape))
        against[..., ~own.decided, :] = log_missed[..., undecided, :]
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(own.existence * own.moving * np.maximum(self.detected, least)) - against)

    def observed(self, rows: Index, numbers: Index, observer: Observers) -> Movers:
        """The objects in ``rows`` updated by the detections ``numbers``, one each; they move, and exist for sure.

        They become relative to the one ``observer``.
        """
        own = self.movers.take(rows).seen_from(observer)
        observers = observer.take(np.zeros(len(rows), dtype=int))
        residual, by_state, by_robot = self._linearised(rows, numbers, observers)
        cross = own.spreads @ np.swapaxes(by_state, -1, -2)
        innovation = by_state @ cross + self._white(numbers)
        gain = cross @ np.linalg.inv(innovation)
        squared, log_determinant = _squared(
            residual, innovation + by_robot @ observer.covariances[0] @ np.swapaxes(by_robot, -1, -2)
        )
        log_speeds = own.log_speeds - 0.5 * (squared + log_determinant)
        return replace(
            own,
            moving=np.ones(own.moving.shape),
            existence=np.ones(own.existence.shape),
            log_speeds=log_speeds - np.logaddexp.reduce(log_speeds, axis=1, keepdims=True),
            means=own.means + np.einsum("tsij,tsj->tsi", gain, residual),
            gains=own.gains - gain @ by_robot,
            spreads=own.spreads - gain @ innovation @ np.swapaxes(gain, -1, -2),
        )

    def places(self, numbers: Index, observers: Observers) -> tuple[Array, Array]:
        """(N, 3) states and (N, 3, 3) covariances of objects as detected by N ``observers``.

        First order, without the prior of their positions.
        """
        turn = rotation(observers.robots)
        points = self.detections.without_sensor_errors(numbers, observers.sensors)
        states, covariances = np.zeros((len(numbers), 3)), np.zeros((len(numbers), 3, 3))
        states[:, :2] = observers.robots[:, :2] + np.einsum("nij,nj->ni", turn, points)
        slope = self._place_by_observer(points, numbers)
        spread = slope @ observers.covariances @ np.swapaxes(slope, 1, 2) + self.detections.covariances[numbers]
        covariances[:, :2, :2] = turn @ spread @ np.swapaxes(turn, 1, 2)
        covariances[:, 2, 2] = HEADING_VARIANCE
        return states, covariances

    def _place_by_observer(self, points: Array, numbers: Index) -> Array:
        """(N, 2, 3 + d) Jacobian, in the body frame, of detected ``points`` (N, 2) by the robot and sensor errors."""
        by_sensor = self.detections.by_sensor
        slope = np.zeros((len(numbers), 2, 3 + by_sensor.shape[2]))
        slope[:, 0, 0] = slope[:, 1, 1] = 1.0
        slope[:, 0, 2], slope[:, 1, 2] = -points[:, 1], points[:, 0]
        slope[..., 3:] = -by_sensor[numbers]
        return slope

    def started(self, numbers: Index, ids: Index, existence: Array, observer: Observers) -> Movers:
        """The moving objects that the detections ``numbers`` may start, seen by the one ``observer``."""
        count, speeds = len(numbers), self.model.speeds
        robot, sensors = observer.robots[0], np.repeat(observer.sensors, count, axis=0)
        turn, place = rotation(observer.robots)[0], self.detections.without_sensor_errors(numbers, sensors)
        by_error = np.sqrt(self.model.errors.correlated_share) * (turn @ self.detections.by_error[numbers])[:, None]
        shape = (count, len(speeds))
        means, gains, spreads = (
            np.zeros((*shape, STATE)),
            np.zeros((*shape, STATE, 3 + sensors.shape[1])),
            np.zeros((*shape, STATE, STATE)),
        )
        means[..., :2] = (robot[:2] + place @ turn.T)[:, None]
        gains[..., :2, :2] = turn
        gains[..., :2, 2] = (np.stack([-place[:, 1], place[:, 0]], axis=1) @ turn.T)[:, None]
        gains[..., :2, 3:] = -(turn @ self.detections.by_sensor[numbers])[:, None]
        spreads[..., :2, :2] = (turn @ self.detections.covariances[numbers] @ turn.T)[:, None]
        spreads[..., 2:4, 2:4] = self.model.speeds[:, None, None] ** 2 * np.eye(2)
        spreads[..., 4:, 4:] = np.eye(2)
        spreads[..., :2, 4:], spreads[..., 4:, :2] = -by_error, -np.swapaxes(by_error, -1, -2)
        known = self.movers.detectable is not None
        return Movers(
            stamp_ns=self.movers.stamp_ns,
            robot=robot,
            sensor=observer.sensors[0],
            stands=self.movers.stands,
            ids=ids,
            moving=np.repeat(self.shares[numbers, None], existence.shape[1], axis=1),
            existence=existence,
            detectable=np.ones(existence.shape) if known else None,
            log_speeds=np.full(shape, -np.log(len(speeds))),
            means=means,
            gains=gains,
            spreads=spreads,
        )

    def _white(self, numbers: Index) -> Array:
        """(N, 1, 2, 2) covariances of the white part of the detections' errors."""
        return (1.0 - self.model.errors.correlated_share) * self.detections.covariances[numbers, None]

    def _linearised(self, rows: Index, numbers: Index, observers: Observers) -> tuple[Array, Array, Array]:
        """(N, S, 2) residuals in the body frame, Jacobians (N, 1, 2, 6) by state and (N, S, 2, 3 + d) by observer.

        Points are linear in the state; the rotation of the robot is linearised at the detection.
        """
        robot, gains = observers.robots, self.movers.gains[rows]
        shift = observers.shifts_from(self.movers.robot, self.movers.sensor)
        states = self.movers.means[rows] + np.einsum("nsij,nj->nsi", gains, shift)
        points = self.detections.without_sensor_errors(numbers, observers.sensors)
        by_state = np.zeros((len(rows), 1, 2, STATE))
        by_state[:, 0, :, :2] = np.swapaxes(rotation(robot), -1, -2)
        by_state[:, 0, :, 4:] = np.sqrt(self.model.errors.correlated_share) * self.detections.by_error[numbers]
        states[..., :2] -= robot[:, None, :2]
        directly = -self._place_by_observer(points, numbers)[:, None]
        residual = points[:, None] - (by_state @ states[..., None])[..., 0]
        return residual, by_state, by_state @ gains + directly


@dataclass(frozen=True, kw_only=True)
class RobotMotion:
    """The predicted motion of the robot between two keyframes; covariances (3 + d, 3 + d) with its sensor's errors."""

    before: Array  # (3,) current estimate
    after: Array  # (3,)
    sensor: Array  # (d,) expected constant errors, before and after
    covariance_before: Array
    cross: Array  # of the pose before with the one after
    covariance: Array  # after
    control: Array  # (3,) from one to the other


def predicted_movers(
    model: Moving,
    movers: Movers,
    motion: RobotMotion,
    stamp_ns: int,
    *,
    region: SensorRegion,
    rates: DetectionRates,
    detections: Sequence[Any],
    labels: Sequence[str],
) -> PredictedMovers:
    """The prediction at ``stamp_ns`` of one hypothesis's moving objects; (D,) ``labels`` of the detections."""
    moved = _moved(model, movers, motion, stamp_ns)
    detected = _detected(moved, motion.covariance, region, rates)
    if moved.detectable is not None:
        detected = detected * (moved.detectable / rates.runs.share)[:, None]
    placed = PlacedDetections.of(detections, model.sensor_sigmas)
    variances = 0.5 * np.trace(moved.spreads[..., :2, :2], axis1=-2, axis2=-1)
    variances[moved.log_speeds < LOG_LEAST_SPEED] = np.inf
    return PredictedMovers(
        model=model,
        movers=moved,
        detections=placed,
        detected_by_speed=detected,
        shares=np.where(placed.has_range, model.shares(labels), 0.0),
        recognised=np.sqrt(variances.min(axis=1)) < LOST_M,
        rates=rates,
    )


def _moved(model: Moving, movers: Movers, motion: RobotMotion, stamp_ns: int) -> Movers:
    """The objects after one motion of the robot, whose new pose becomes the reference."""
    elapsed_s = max(stamp_ns - movers.stamp_ns, 0) / 1e9
    sensor, covariances = motion.sensor[None], motion.covariance_before[None]
    known = movers.seen_from(Observers(robots=motion.before[None], sensors=sensor, covariances=covariances))
    transition, noise = _transition(model, known, motion.control, elapsed_s)
    turned = np.swapaxes(transition, -1, -2)
    by_robot = known.gains @ motion.covariance_before @ np.swapaxes(known.gains, -1, -2)
    gains = transition @ known.gains @ motion.cross @ np.linalg.inv(motion.covariance)
    spreads = transition @ (known.spreads + by_robot) @ turned + noise
    return replace(
        known,
        stamp_ns=stamp_ns,
        robot=motion.after,
        means=(transition @ known.means[..., None])[..., 0],
        gains=gains,
        spreads=spreads - gains @ motion.covariance @ np.swapaxes(gains, -1, -2),
    )


def _transition(model: Moving, movers: Movers, control: Array, elapsed_s: float) -> tuple[Array, Array]:
    """(T, S, 6, 6) state transition matrices and process noise covariances."""
    shape = (*movers.means.shape[:2], STATE, STATE)
    transition, noise = np.zeros(shape), np.zeros(shape)
    transition[..., :4, :4], noise[..., :4, :4] = model.transition(elapsed_s), model.noise(elapsed_s)
    variance = 0.5 * elapsed_s**2 * np.trace(movers.spreads[..., 2:4, 2:4], axis1=-2, axis2=-1)
    repeats = model.repeats(control, elapsed_s * movers.means[..., 2:4], variance)
    for at in (0, 1):
        transition[..., 4 + at, 4 + at] = repeats[..., at]
        noise[..., 4 + at, 4 + at] = 1.0 - repeats[..., at] ** 2
    return transition, noise


def _detected(movers: Movers, covariance: Array, region: SensorRegion, rates: DetectionRates) -> Array:
    """(T, S, G) detection probabilities if they exist and move, without occlusion."""
    if not len(movers):
        return np.zeros((*movers.log_speeds.shape, len(rates)))
    turn = rotation(movers.robot[None])[0]
    relative = (movers.means[..., :2] - movers.robot[:2]) @ turn
    slope = turn.T @ movers.gains[..., :2, :]
    slope[..., 0, 0] -= 1.0
    slope[..., 1, 1] -= 1.0
    slope[..., 0, 2] += relative[..., 1]
    slope[..., 1, 2] -= relative[..., 0]
    spread = turn.T @ movers.spreads[..., :2, :2] @ turn + slope @ covariance @ np.swapaxes(slope, -1, -2)
    inside = region.contains(relative, spread)
    fall_off = rates.fall_off(np.hypot(relative[..., 0], relative[..., 1]))
    fall_off = rates.by_direction.times(fall_off, relative, region.direction_rad)
    return np.asarray(rates.probability * inside[..., None] * fall_off)


def as_objects(movers: Movers, observer_covariance: Array) -> tuple[Array, Array]:
    """(T, 3) states and (T, 3, 3) covariances of moving objects in the form of static ones; headings are unknown."""
    mean, spread = movers.moments(observer_covariance)
    states, covariances = np.zeros((len(movers), 3)), np.zeros((len(movers), 3, 3))
    states[:, :2], covariances[:, :2, :2] = mean[:, :2], spread[:, :2, :2]
    covariances[:, 2, 2] = HEADING_VARIANCE
    return states, covariances


def rotation(poses: Array) -> Array:
    """(N, 2, 2) rotations from the body frames of poses (N, 3) to map."""
    found = np.empty((len(poses), 2, 2))
    found[:, 0, 0] = found[:, 1, 1] = np.cos(poses[:, 2])
    found[:, 1, 0] = np.sin(poses[:, 2])
    found[:, 0, 1] = -found[:, 1, 0]
    return found


def _squared(residual: Array, spread: Array) -> tuple[Array, Array]:
    """(..., ) squared Mahalanobis distances of (..., 2) under (..., 2, 2), and the log determinants of these."""
    a, b, c = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    x, y = residual[..., 0], residual[..., 1]
    determinant = a * c - b * b
    return (c * x * x - 2.0 * b * x * y + a * y * y) / determinant, np.log(determinant)
