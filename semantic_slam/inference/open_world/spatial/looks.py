"""From which of the robot's poses its camera has looked at a place: in its image, near enough, and nothing before it.

All places by all poses, one coordinate at a time: sums over an axis of three cost several times as much.
"""

import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array, Flags, Index, squared_norms
from semantic_slam.inference.open_world.spatial.region import SpatialRegion


def looks(region: SpatialRegion, trail: Array, points: Array, hiding: Array) -> tuple[Index, Index, Array]:
    """(L,) which of ``points`` (D, 3) the poses ``trail`` (T, 7) have in the region, from where, at what range [m].

    By points, and then by poses; without those that one of the objects ``hiding`` (N, 3) stands before.
    """
    cameras = region.camera.on(trail)
    away = [points[:, None, axis] - cameras[:, axis] for axis in range(3)]
    squared = _dot(away, away)
    near = (squared > region.min_range_m**2) & (squared < region.max_range_m**2)
    axes = so3.matrix(cameras[:, 3:])
    right, down, ahead = (_dot([axes[:, axis, own] for axis in range(3)], away) for own in range(3))
    numbers, times = np.nonzero(near & region.shows(right, down, ahead))
    ranges = np.sqrt(squared[numbers, times])
    if region.occluder_radius_m > 0.0 and len(hiding):
        rays = np.stack([own[numbers, times] for own in away], axis=1) / ranges[:, None]
        free = ~_hidden(region.occluder_radius_m, rays, ranges, cameras[:, :3], times, hiding)
        numbers, times, ranges = numbers[free], times[free], ranges[free]
    return numbers, times, ranges


def _hidden(radius_m: float, rays: Array, ranges: Array, cameras: Array, times: Index, hiding: Array) -> Flags:
    """(L,) whether one of N balls about ``hiding`` (N, 3) stands before what is seen at ``times`` (L,).

    From ``cameras`` (T, 3), at ``ranges`` (L,) along ``rays`` (L, 3).
    """
    squared = squared_norms(hiding - cameras[:, None])
    along = (rays @ hiding.T) - np.vecdot(rays, cameras[times])[:, None]
    aside = squared[times] - along * along < radius_m**2
    behind = ranges[:, None] > (np.sqrt(squared) + 2.0 * radius_m)[times]
    return np.asarray((aside & behind & (along > 0.0)).any(axis=1))


def _dot(one: list[Array], other: list[Array]) -> Array:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
