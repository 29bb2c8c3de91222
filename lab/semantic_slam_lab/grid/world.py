"""The world of chapter 4's benchmarks: a regular grid of objects of one class, and a robot that is lost by 10 m.

Noise, visibility limits and class model are those of the thesis's study. Everything about a world follows from its
seed; what the robot sees is plain arrays, so that peers need nothing of the engine.
"""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel
from semantic_slam_lab.repetitions import keyed_generator

SPACING_M = 3.0
RADIUS_M = 5.0
"""Radius of the circle about the grid that the robot follows, looking at the grid's middle."""
TURN_RAD = 0.16
"""Angle of that circle from one keyframe to the next: 0.8 m."""


@dataclass(frozen=True)
class Noise:
    """Variances, metres and radians."""

    robot: tuple[float, ...] = (100.0, 100.0, 0.04)
    objects: tuple[float, ...] = (0.05, 0.05, 0.0005)
    motion: tuple[float, ...] = (0.00075, 0.00075, 0.00025)
    geometry: tuple[float, ...] = (0.1, 0.05)  # range, bearing


@dataclass(frozen=True)
class Sensor:
    """What the robot sees, and the two-class model of Eq. 4.22."""

    max_range_m: float = 7.5
    field_of_view_rad: float = 2.443460952792061
    alpha: float = 0.25
    concentration: float = 15.0


@dataclass(frozen=True)
class Frame:
    """One keyframe with n detections."""

    control: Array  # (3,) from the previous pose
    objects: tuple[int, ...]  # (n,) truth
    geometry: Array  # (n, 2) range [m] and bearing [rad]
    features: Array  # (n, 2)


@dataclass(frozen=True)
class World:
    """Priors, frames and truth; N objects. All covariances are diagonal, in the tangent spaces at the means."""

    robot_mean: Array  # (3,)
    object_means: Array  # (N, 3)
    frames: tuple[Frame, ...]
    truth: Array  # (K + 1, 3) the robot, from before the first frame on
    noise: Noise = field(default_factory=Noise)
    sensor: Sensor = field(default_factory=Sensor)

    def predicted_robot(self) -> tuple[Array, Array]:
        """(3,) mean and (3, 3) covariance of b^-[x_1] (Eq. 4.21), in the tangent space at the mean."""
        control = self.frames[0].control
        transition = se2.inverse_adjoint(control)
        covariance = transition @ np.diag(self.noise.robot) @ transition.T + np.diag(self.noise.motion)
        return se2.compose(self.robot_mean, control), covariance


def grid_world(
    seed: int,
    *,
    num_detections: int = 3,
    num_keyframes: int = 1,
    shape: tuple[int, int] = (3, 2),
    aligned: bool = False,
    noise: Noise | None = None,
    sensor: Sensor | None = None,
) -> World:
    """Objects of class 1 on a grid of ``shape``; the robot starts anywhere on its circle.

    ``aligned`` objects share a heading, so that neighbouring parts of the grid look alike; else headings are random.

    Raises ValueError where it does not see ``num_detections`` objects.
    """
    noise, sensor = noise or Noise(), sensor or Sensor()
    random = keyed_generator("grid_world", seed)
    means = _grid(shape, aligned, random)
    objects = se2.compose(means, se2.exp(random.normal(size=means.shape) * np.sqrt(noise.objects)))
    phase = random.uniform(-np.pi, np.pi)
    start = x = _on_circle(phase)
    frames, truth = [], [start]
    for k in range(num_keyframes):
        control = se2.between(_on_circle(phase + k * TURN_RAD), _on_circle(phase + (k + 1) * TURN_RAD))
        x = se2.compose(se2.compose(x, control), se2.exp(random.normal(size=3) * np.sqrt(noise.motion)))
        frames.append(_frame(control, x, objects, num_detections, noise, sensor, random))
        truth.append(x)
    mean = se2.compose(start, se2.exp(random.normal(size=3) * np.sqrt(noise.robot)))
    return World(mean, means, tuple(frames), np.array(truth), noise, sensor)


def _grid(shape: tuple[int, int], aligned: bool, random: np.random.Generator) -> Array:
    places = np.stack(np.meshgrid(*(SPACING_M * (np.arange(n) - (n - 1) / 2.0) for n in shape), indexing="ij"), -1)
    count = shape[0] * shape[1]
    headings = random.uniform(-np.pi, np.pi, (1 if aligned else count, 1)) * np.ones((count, 1))
    return np.concatenate([places.reshape(count, 2), headings], axis=1)


def _on_circle(phase: float) -> Array:
    """(3,) pose that looks at the origin."""
    heading = np.angle(-np.exp(1j * phase))
    return np.array([RADIUS_M * np.cos(phase), RADIUS_M * np.sin(phase), heading])


def _frame(
    control: Array, x: Array, objects: Array, count: int, noise: Noise, sensor: Sensor, random: np.random.Generator
) -> Frame:
    relative = se2.between(np.broadcast_to(x, objects.shape), objects)
    distance, bearing = np.hypot(relative[:, 0], relative[:, 1]), np.arctan2(relative[:, 1], relative[:, 0])
    visible = np.flatnonzero((distance <= sensor.max_range_m) & (np.abs(bearing) <= sensor.field_of_view_rad / 2.0))
    if len(visible) < count:
        raise ValueError(f"{len(visible)} objects are in sight, {count} detections are wanted")
    seen = random.permutation(visible)[:count]
    clean = np.stack([distance[seen], bearing[seen]], axis=-1)
    geometry = clean + random.normal(size=(count, 2)) * np.sqrt(noise.geometry)
    model = ParametricModel(sensor.alpha, sensor.concentration)
    camera = se2.between(objects[seen], np.broadcast_to(x, (count, 3)))
    azimuth = np.arctan2(camera[:, 1], camera[:, 0])
    prediction = model.predict(np.zeros(count, dtype=int), Viewpoints(azimuth, 0.0 * azimuth, distance[seen]))
    root = np.linalg.cholesky(prediction.covariance)
    features = prediction.mean + (root @ random.normal(size=(count, 2, 1)))[..., 0]
    return Frame(control, tuple(int(n) for n in seen), geometry, features)
