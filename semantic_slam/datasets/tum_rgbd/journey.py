"""How the camera of a folder moved: where map is, the truth in it, and what odometry has of it."""

import numpy as np

from semantic_slam.datasets.space.drive import PlacedObjects, SpatialDrive
from semantic_slam.datasets.space.levelling import level_start, map_of_start
from semantic_slam.datasets.space.noisy_odometry import noisy_odometry_in_space
from semantic_slam.datasets.space.path import SpatialPath
from semantic_slam.datasets.tum_rgbd.folder import TumFolder
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array

UP = np.array([0.0, 0.0, 1.0])
"""In the world of the true poses: that of motion capture stands on the floor."""


def spatial_drive(
    folder: TumFolder, drift: float, seed: int, up: Array | None = None, objects: PlacedObjects | None = None
) -> SpatialDrive:
    """The drive of a folder without what was seen; ``up`` (3,) is that of the body at the start, where it is known.

    Odometry is the folder's own, or the truth's increments with noise. ``objects`` are in the world of the true poses.
    """
    truth = folder.truth
    if folder.odometry is not None:
        odometry = folder.odometry
        truth = None if truth is None else truth.since(int(odometry.stamps_ns[0]))
    else:
        assert truth is not None  # a folder has one of the two
        rng = np.random.default_rng([seed, *folder.path.resolve().name.encode()])
        odometry = noisy_odometry_in_space(truth.thinned(), drift, rng)
    seen = _up(odometry, truth) if up is None else up
    start = level_start(seen)
    if truth is None:
        return SpatialDrive(start=start, odometry=odometry, frames=[])
    T_map_world = map_of_start(truth.poses[0], so3.rotated(truth.poses[0, 3:], seen))
    return SpatialDrive(
        start=start,
        odometry=odometry,
        frames=[],
        truth=truth.moved(T_map_world),
        objects=None if objects is None else _moved(objects, T_map_world),
    )


def _up(odometry: SpatialPath, truth: SpatialPath | None) -> Array:
    """(3,) in the body at the start: by the world of the truth, or of the odometry."""
    first = (odometry if truth is None else truth).poses[0]
    return so3.rotated(so3.inverse(first[3:]), UP)


def _moved(objects: PlacedObjects, T_map_world: Array) -> PlacedObjects:
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(objects.positions), 1))
    placed = se3.compose(T_map_world, np.hstack([objects.positions, turns]))
    return PlacedObjects(object_ids=objects.object_ids, class_names=objects.class_names, positions=placed[:, :3])
