"""Rooms without a map, drawn from what ``config/open_world.yaml`` takes them to be: misses, false alarms, hiding."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import Configuration, OpenWorldConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.noise.odometry_noise import odometry_covariance
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints, feature_names

SIDE_M, LOOP_RADIUS_M, LOOP_KEYFRAMES = 16.0, 2.5, 40
"""Sizes of the square with objects, of the drive's circle about its middle, and of one lap of it."""
FALSE_ALARM = -1


@dataclass(frozen=True, kw_only=True)
class OpenRoom:
    """K keyframes and what their detections are of; M objects."""

    keyframes: tuple[Keyframe, ...]  # K
    truth: Array  # (K, 3)
    objects: Array  # (M, 3)
    labels: tuple[tuple[int, ...], ...]  # K: object of each detection, or FALSE_ALARM


@dataclass(frozen=True, kw_only=True)
class _Furniture:
    """M objects."""

    poses: Array  # (M, 3)
    classes: Index  # (M,)


def open_room(
    configuration: Configuration,
    num_keyframes: int,
    random: np.random.Generator,
    carried: Mapping[int, Array] | None = None,
) -> OpenRoom:
    """One room and one drive, from ``configuration``'s densities, rates and noises.

    ``carried``: keyframe -> pose (3,) to which the robot is carried, of which odometry tells nothing.
    """
    model = load_model(configuration.semantic_model)
    assert model is not None
    count = random.poisson(configuration.open_world.birth_density * SIDE_M**2)
    places = random.uniform(-0.5 * SIDE_M, 0.5 * SIDE_M, size=(count, 2))
    poses = np.column_stack([places, random.uniform(-np.pi, np.pi, count)])
    furniture = _Furniture(poses=poses, classes=random.integers(len(model.class_names), size=count))
    turn = 2.0 * np.pi / LOOP_KEYFRAMES
    pose = np.array([0.0, -LOOP_RADIUS_M, 0.0])
    step = np.array([LOOP_RADIUS_M * np.sin(turn), LOOP_RADIUS_M * (1.0 - np.cos(turn)), turn])
    keyframes, truth, labels = [], [], []
    for index in range(num_keyframes):
        there = carried.get(index) if carried is not None else None
        told = step if index and there is None else np.zeros(3)
        covariance = odometry_covariance(float(np.hypot(*told[:2])), abs(float(told[2])), configuration.odometry)
        if there is not None:
            pose = there
        elif index:
            pose = se2.compose(se2.compose(pose, told), se2.exp(np.linalg.cholesky(covariance) @ random.normal(size=3)))
        detections, own = _look(configuration, model, furniture, pose, random)
        sigmas = np.sqrt(np.diag(covariance))
        keyframes.append(Keyframe.planar(index, motion=told, detections=detections, motion_sigmas=sigmas))
        truth.append(pose)
        labels.append(own)
    return OpenRoom(keyframes=tuple(keyframes), truth=np.array(truth), objects=poses, labels=tuple(labels))


def _look(
    configuration: Configuration,
    model: ViewpointModel,
    furniture: _Furniture,
    pose: Array,
    random: np.random.Generator,
) -> tuple[list[Detection], tuple[int, ...]]:
    """Detections in any order, and what they are of."""
    settings, perception, names = configuration.open_world, configuration.perception, feature_names(model)
    relative = se2.between(np.broadcast_to(pose, furniture.poses.shape), furniture.poses)[:, :2]
    seen = np.flatnonzero(
        _in_sight(relative, settings) & (random.random(len(relative)) < settings.detection_probability)
    )
    false = _anywhere(settings, int(random.poisson(settings.clutter_per_frame)), random)
    places = np.concatenate([relative[seen], false])
    labels = np.concatenate([seen, np.full(len(false), FALSE_ALARM)]).astype(int)
    noise = random.normal(size=(len(places), 2)) * [perception.sigma_range_m, perception.sigma_bearing_rad]
    order = random.permutation(len(places))
    detections = [
        Detection(
            range_m=max(float(np.hypot(*places[row]) + noise[row, 0]), 0.05),
            bearing_rad=float(np.arctan2(places[row, 1], places[row, 0]) + noise[row, 1]),
            class_scores=dict(zip(names, _scores(model, furniture, pose, int(labels[row]), random), strict=True)),
        )
        for row in order
    ]
    return detections, tuple(labels[order].tolist())


def _in_sight(relative: Array, settings: OpenWorldConfiguration) -> Flags:
    """(M,) whether objects at ``relative`` (M, 2) lie in the region, and nothing nearer hides their centres."""
    distance, bearing = np.hypot(*relative.T), np.arctan2(relative[:, 1], relative[:, 0])
    inside = (distance > settings.min_range_m) & (distance < settings.max_range_m)
    inside &= np.abs(bearing) < 0.5 * settings.field_of_view_rad
    half = np.arcsin(np.minimum(settings.occluder_radius_m / np.maximum(distance, 1e-6), 1.0))
    between = np.abs((bearing[:, None] - bearing + np.pi) % (2.0 * np.pi) - np.pi) < half
    nearer = distance < distance[:, None] - settings.occluder_radius_m
    return np.asarray(inside & ~(between & nearer).any(axis=1))


def _anywhere(settings: OpenWorldConfiguration, count: int, random: np.random.Generator) -> Array:
    """(count, 2) evenly in the region."""
    distance = np.sqrt(random.uniform(settings.min_range_m**2, settings.max_range_m**2, size=count))
    bearing = settings.field_of_view_rad * random.uniform(-0.5, 0.5, size=count)
    return np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=1)


def _scores(
    model: ViewpointModel, furniture: _Furniture, pose: Array, label: int, random: np.random.Generator
) -> list[float]:
    """(F,) drawn from the class models; a false alarm looks like some object from somewhere."""
    if label == FALSE_ALARM:
        number, azimuth, distance = int(random.integers(len(model.class_names))), random.uniform(-np.pi, np.pi), 1.0
    else:
        camera = se2.between(furniture.poses[label], pose)
        number, azimuth = int(furniture.classes[label]), float(np.arctan2(camera[1], camera[0]))
        distance = float(np.hypot(*camera[:2]))
    expected = model.predict(np.array([number]), Viewpoints(np.array([azimuth]), np.zeros(1), np.array([distance])))
    return [float(score) for score in random.multivariate_normal(expected.mean[0], expected.covariance[0])]
