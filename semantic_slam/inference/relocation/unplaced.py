"""Moments in map of a robot that is not localised on it: its own frame may lie anywhere."""

from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.pose import (
    covariance_from_planar,
    planar_from_covariance,
    planar_from_pose_vector,
    pose_vector_from_planar,
)
from semantic_slam.inference.rounds import HeldComponent
from semantic_slam.inference.world.starts import Starts


def in_map(held: HeldComponent, starts: Starts, on_map: Flags) -> HeldComponent:
    """A component with robot and objects transformed to map; (O,) objects that are ``on_map`` stay as they are."""
    objects = held.objects
    pose, covariance = _moved(held.pose[None], held.covariance[None], starts)
    poses, covariances = objects.object_poses.copy(), objects.object_covariances.copy()
    own = ~on_map & np.isfinite(poses).all(axis=-1)
    poses[own], covariances[own] = _moved(poses[own], covariances[own], starts)
    objects = replace(objects, object_poses=poses, object_covariances=covariances)
    return replace(held, pose=pose[0], covariance=covariance[0], objects=objects)


def _moved(poses: Array, covariances: Array, starts: Starts) -> tuple[Array, Array]:
    """(n, 7) poses and (n, 6, 6) covariances transformed to map."""
    means, spreads = starts.in_map(planar_from_pose_vector(poses), planar_from_covariance(covariances))
    return pose_vector_from_planar(means), covariance_from_planar(spreads)
