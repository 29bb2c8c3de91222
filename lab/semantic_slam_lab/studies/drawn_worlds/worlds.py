"""Worlds drawn from the priors that the configuration of an open world states, or from others that it does not know."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.noise.clock_offset import OFFSETS, shifts_of
from semantic_slam.inference.models.noise.noise_settings import DEPTH, shares_of_odometry
from semantic_slam.inference.models.noise.odometry_noise import odometry_covariance
from semantic_slam.inference.models.odometry_bias import CLOCK, bias_sigmas, slopes
from semantic_slam.inference.states.miss_runs import MissRuns
from semantic_slam_lab.studies.drawn_worlds.errors import RepeatedErrors
from semantic_slam_lab.studies.drawn_worlds.path import Path

INTERVAL_S, FIRST_S = 0.8, 2.0
"""Between keyframes, and of the first one; the robot is at rest before 0, whatever the clock."""
LEAST_RANGE_M, MOST_RANGE_M, FIELD_OF_VIEW_RAD = 0.4, 4.0, 2.0
"""Region of the sensor."""
MARGIN_M = 6.0
"""Around the drive there are objects."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What a world is drawn from beyond the configuration; the defaults add nothing to it."""

    noise: float | None = None  # factor on the standard deviations of odometry and detections; None: drawn for each
    correlated_share: float | None = None  # of a detection's variance; None: as configured
    outliers: float = 0.0  # share of detections whose place is anywhere in the region
    turn_rad_per_m: float | None = None  # of odometry's bias; None: drawn from its prior


@dataclass(frozen=True, kw_only=True)
class DrawnWorld:
    """K keyframes with the truth; M objects."""

    keyframes: list[Keyframe]
    poses: Array  # (K, 3)
    objects: Array  # (M, 2)
    detected: list[tuple[int, ...]]  # of each keyframe's detections: the object, -1 for none
    biases: Array  # (4,) of odometry, in their units
    detection_probability: float


class _Sensor:
    """Detections of one world."""

    def __init__(self, configuration: Configuration, truth: Truth, objects: Array, random: np.random.Generator) -> None:
        self.random, self.objects, self.truth = random, objects, truth
        self.probability = float(random.choice(configuration.open_world.detection_probabilities))
        self._half_range_m = float(random.choice(configuration.open_world.detection_half_ranges_m or (np.inf,)))
        drawn = np.sqrt(random.choice(configuration.perception.noise_factors))
        self._noise = float(drawn) if truth.noise is None else truth.noise
        rates = configuration.open_world
        persistence = float(random.choice(rates.miss_persistences or (rates.miss_persistence,)))
        self._runs = MissRuns(self.probability, persistence)
        self._detectable: Flags = random.random(len(objects)) < self._runs.share
        clutters = configuration.open_world.clutters_per_frame or (configuration.open_world.clutter_per_frame,)
        self._clutter, self._perception = float(random.choice(clutters)), configuration.perception
        errors = configuration.detection_errors
        share = float(random.choice(errors.correlated_shares)) if errors.correlated_shares else errors.correlated_share
        self._share = share if truth.correlated_share is None else truth.correlated_share
        self._errors = RepeatedErrors(errors)
        self._metre = 1.0 + self._perception.sigma_range_scale * float(random.normal())
        self._is_depth = str(random.choice(self._perception.ranges_are)) == DEPTH

    def look(self, pose: Array, motion: Array) -> tuple[list[Detection], tuple[int, ...]]:
        """From ``pose`` after a ``motion``, which odometry tells: detections in any order, and what they are of."""
        self._errors.move(motion)
        seen = np.flatnonzero(self._detections(pose))
        places = _relative(pose, self.objects[seen])
        wrong = self.random.random(len(seen)) < self.truth.outliers
        false = self._anywhere(int(self.random.poisson(self._clutter) + wrong.sum()))
        places = np.concatenate([places[~wrong], false])
        labels = np.concatenate([seen[~wrong], np.full(len(false), -1)]).astype(int)
        order = self.random.permutation(len(places))
        return self._measured(places[order]), tuple(labels[order].tolist())

    def _detections(self, pose: Array) -> Flags:
        count = len(self.objects)
        stays = self.random.random(count) < self._runs.persistence
        self._detectable = np.where(stays, self._detectable, self.random.random(count) < self._runs.share)
        places = _relative(pose, self.objects)
        distance, bearing = np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])
        inside = (distance > LEAST_RANGE_M) & (distance < MOST_RANGE_M) & (np.abs(bearing) < 0.5 * FIELD_OF_VIEW_RAD)
        hit = self._runs.hit * np.exp2(-((distance / self._half_range_m) ** 2))
        return np.asarray(inside & self._detectable & (self.random.random(count) < hit))

    def _anywhere(self, count: int) -> Array:
        distance = np.sqrt(self.random.uniform(LEAST_RANGE_M**2, MOST_RANGE_M**2, size=count))
        bearing = self.random.uniform(-0.5, 0.5, size=count) * FIELD_OF_VIEW_RAD
        return np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=1)

    def _measured(self, places: Array) -> list[Detection]:
        if not len(places):
            return []
        repeated, white = self._errors.draw(places, self.random), self.random.normal(size=(len(places), 2))
        errors = self._noise * (np.sqrt(self._share) * repeated + np.sqrt(1.0 - self._share) * white)
        bearing = np.arctan2(places[:, 1], places[:, 0])
        told = self._metre * (places[:, 0] if self._is_depth else np.hypot(*places.T))
        sigma = np.hypot(self._perception.sigma_range_m, self._perception.sigma_range_per_m * told)
        ranges = np.maximum(told + sigma * errors[:, 0], 0.05)
        bearings = bearing + self._perception.sigma_bearing_rad * errors[:, 1]
        return [Detection(range_m=float(r), bearing_rad=float(b)) for r, b in zip(ranges, bearings, strict=True)]


def drawn_world(
    configuration: Configuration, num_keyframes: int, random: np.random.Generator, truth: Truth | None = None
) -> DrawnWorld:
    """One world; ``truth`` None: everything as ``configuration`` has it."""
    truth = truth or Truth()
    odometry, sigmas = configuration.odometry, bias_sigmas(configuration.odometry)
    biases = sigmas * random.normal(size=len(sigmas))
    if truth.turn_rad_per_m is not None:
        biases[0] = truth.turn_rad_per_m
    path = Path.drawn(random, FIRST_S + num_keyframes * INTERVAL_S)
    times = np.concatenate([[0.0], FIRST_S + INTERVAL_S * np.arange(num_keyframes)])
    objects = _objects(path, float(random.choice(configuration.open_world.birth_densities)), random)
    sensor = _Sensor(configuration, truth, objects, random)
    shares = shares_of_odometry(odometry.noise_factors)
    drawn = float(np.sqrt(random.choice(odometry.noise_factors, p=shares)))
    scale = drawn if truth.noise is None else truth.noise
    pose = np.array(configuration.initial_pose.mean)
    pose = se2.compose(pose, se2.exp(np.array(configuration.initial_pose.sigma) * random.normal(size=3)))
    keyframes, poses, detected = [], [], []
    for index in range(num_keyframes):
        span = times[index], times[index + 1]
        controls = np.array([path.motion(*_shifted(span, offset * sigmas[2])) for offset in OFFSETS])
        told = controls[len(OFFSETS) // 2]
        covariance = odometry_covariance(*path.extent(*span), odometry)
        moved = path.motion(*_shifted(span, biases[CLOCK]))
        noise = scale * np.linalg.cholesky(covariance) @ random.normal(size=3)
        pose = se2.compose(se2.compose(pose, moved), se2.exp(slopes(moved) @ biases[:CLOCK] + noise))
        detections, labels = sensor.look(pose, told)
        sigma = np.sqrt(np.diag(covariance))
        keyframe = Keyframe.planar(index, motion=told, detections=detections, motion_sigmas=sigma)
        keyframes.append(replace(keyframe, odometry_shifts=shifts_of(controls)))
        poses.append(pose)
        detected.append(labels)
    return DrawnWorld(
        keyframes=keyframes,
        poses=np.array(poses),
        objects=objects,
        detected=detected,
        biases=biases,
        detection_probability=sensor.probability,
    )


def _shifted(span: tuple[float, float], offset_s: float) -> tuple[float, float]:
    """By the clock of odometry; the drive begins at rest, so that its start is not shifted."""
    start, end = span
    return (start + offset_s if start > 0.0 else 0.0), end + offset_s


def _objects(path: Path, density: float, random: np.random.Generator) -> Array:
    """(M, 2) evenly around the drive, so many per square metre."""
    low, high = path.corners[:, :2].min(axis=0) - MARGIN_M, path.corners[:, :2].max(axis=0) + MARGIN_M
    count = random.poisson(density * float(np.prod(high - low)))
    return random.uniform(low, high, size=(count, 2))


def _relative(pose: Array, points: Array) -> Array:
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray((points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]]))
