"""Likely poses of a carried robot: detections since a keyframe, placed by odometry, matched to the map before it."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.relocation.alike import log_alike
from semantic_slam.inference.relocation.likelihood_field import LikelihoodField
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem

PLACES = 24
"""Number of poses returned."""
NEWEST = 12
"""Newest keyframes that are also fitted by themselves: it may take long until a mapped object comes into view."""
LEAST_SEEN = 3
"""Number of detections from which on the robot may be localised by them."""
LARGEST_SIGMA_M, LEAST_EXISTENCE = 1.0, 0.3
"""Largest standard deviation and least existence of an object that is used for localisation."""
REACH_SIGMAS = 3.0


def likely_poses(problem: Problem, registry: ObjectRegistry, component: Component, steps: Sequence[Step]) -> Array:
    """(P, 3) poses at the first of ``steps``; ``component`` is that before it."""
    path, count = _path(steps), len(steps)
    if count <= NEWEST:
        return _fitting(problem, registry, component, _seen(steps, path), PLACES)
    newest = _seen(steps[-NEWEST:], path[-NEWEST:])
    halves = [_fitting(problem, registry, component, seen, PLACES // 2) for seen in (_seen(steps, path), newest)]
    return np.concatenate(halves)


def num_seen(steps: Sequence[Step]) -> int:
    """Number of detections in some keyframes."""
    return sum(len(step.detections) for step in steps)


def _fitting(
    problem: Problem,
    registry: ObjectRegistry,
    component: Component,
    what: tuple[Array, list[PlanarDetection]],
    most: int,
) -> Array:
    """(P, 3) poses at which some detections, at places (N, 2) from there, fit the map best."""
    (places, seen), (ids, points, sigmas) = what, _known_well(component)
    if len(seen) < LEAST_SEEN or not ids or problem.carried is None:
        return np.zeros((0, 3))
    robot, variance = component.newest_robot()[:3], float(problem.carried.motions.covariance[0, 0])
    alike = log_alike(problem.viewpoint, component, ids, registry.log_class_prior_of(ids), seen)
    reach_m = float(np.hypot(*places.T).max())
    field = LikelihoodField.of(robot[:2], REACH_SIGMAS * float(np.sqrt(variance)), reach_m, points, sigmas, alike)
    return field.likeliest(places, lambda poses: -0.5 * squared_norms(poses[..., :2] - robot[:2]) / variance, most)


def _path(steps: Sequence[Step]) -> Array:
    """(T, 3) poses relative to the first of some keyframes, by odometry."""
    poses = [np.zeros(3)]
    for step in steps[1:]:
        poses.append(se2.compose(poses[-1], step.motion.control))
    return np.array(poses)


def _seen(steps: Sequence[Step], path: Array) -> tuple[Array, list[PlanarDetection]]:
    """(N, 2) positions of the detections of keyframes along a path (T, 3), and the detections."""
    pairs = [
        (pose, own)
        for pose, step in zip(path, steps, strict=True)
        for own in step.detections
        if isinstance(own, PlanarDetection)
    ]
    places = [se2.compose(pose, np.append(own.place, 0.0))[:2] for pose, own in pairs]
    return np.reshape(places, (-1, 2)), [own for _, own in pairs]


def _known_well(component: Component) -> tuple[list[int], Array, Array]:
    """Ids of M objects that are likely to exist and well localised, their positions (M, 2) and sigmas [m]."""
    known = component.objects
    ids = known.ids[known.existence > LEAST_EXISTENCE].tolist()
    spreads = [component.joint_covariance([object_key(n)])[:2, :2] for n in ids]
    sigmas = np.sqrt([0.5 * float(np.trace(own)) for own in spreads])
    is_known = sigmas < LARGEST_SIGMA_M
    well = [n for n, own in zip(ids, is_known.tolist(), strict=True) if own]
    points = component.states([object_key(n) for n in well])[:, :2] if well else np.zeros((0, 2))
    return well, points, sigmas[is_known]
