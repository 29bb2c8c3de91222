"""How a camera in space moved: where map is, the truth in it, and what odometry has of it."""

import numpy as np

from semantic_slam.datasets.space.drive import PlacedObjects, SpatialDrive
from semantic_slam.datasets.space.levelling import level_start, map_of_start
from semantic_slam.datasets.space.noisy_odometry import noisy_odometry_in_space
from semantic_slam.datasets.space.path import SpatialPath
from semantic_slam.errors import InputError
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array

UP = np.array([0.0, 0.0, 1.0])
"""In the world of true poses by motion capture, which stands on the floor."""


def drive_by_odometry(
    odometry: SpatialPath,
    truth: SpatialPath | None = None,
    *,
    up_in_world: Array = UP,
    up: Array | None = None,
    objects: PlacedObjects | None = None,
) -> SpatialDrive:
    """The drive of a body without what was seen, in map.

    ``truth``, ``objects`` and ``up_in_world`` (3,) are in the world of the true poses, which without these is that of
    the odometry; ``up`` (3,) is that of the body at the start where something else tells it.
    """
    known = odometry if truth is None else truth.since(int(odometry.stamps_ns[0]))
    first = known.poses[0]
    seen = so3.rotated(so3.inverse(first[3:]), up_in_world) if up is None else up
    if truth is None:
        return SpatialDrive(start=level_start(seen), odometry=odometry, frames=[])
    T_map_world = map_of_start(first, so3.rotated(first[3:], seen))
    return SpatialDrive(
        start=level_start(seen),
        odometry=odometry,
        frames=[],
        truth=known.moved(T_map_world),
        objects=None if objects is None else _moved(objects, T_map_world),
    )


def odometry_of(told: SpatialPath | None, truth: SpatialPath | None, name: str, drift: float, seed: int) -> SpatialPath:
    """The odometry of a source, or the true increments with noise by its ``name``. Raises InputError without both."""
    if told is not None:
        return told
    if truth is None:
        raise InputError(f"{name}: neither poses nor odometry; give the camera's odometry")
    return noisy_odometry_in_space(truth.thinned(), drift, np.random.default_rng([seed, *name.encode()]))


def _moved(objects: PlacedObjects, T_map_world: Array) -> PlacedObjects:
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(objects.positions), 1))
    placed = se3.compose(T_map_world, np.hstack([objects.positions, turns]))
    return PlacedObjects(object_ids=objects.object_ids, class_names=objects.class_names, positions=placed[:, :3])
