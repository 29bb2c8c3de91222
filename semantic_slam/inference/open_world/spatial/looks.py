"""Earlier looks: the robot poses from which a place was in the camera's image, in range and not occluded.

All places by all poses, as matrix products: entry by entry it costs several times as much.
"""

import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array, Flags, Index, squared_norms
from semantic_slam.inference.open_world.spatial.region import SpatialRegion


def looks(region: SpatialRegion, trail: Array, points: Array, hiding: Array) -> tuple[Index, Index, Array]:
    """(L,) which of ``points`` (D, 3) are in the region from poses ``trail`` (T, 7), from which, and the range [m].

    Sorted by points, then by poses; without those that one of the objects ``hiding`` (N, 3) occludes.
    """
    cameras = region.camera.on(trail)
    right, down, ahead = _seen(cameras, points)
    squared = right * right + down * down + ahead * ahead
    near = (squared > region.min_range_m**2) & (squared < region.max_range_m**2)
    inside = near & region.shows(right, down, ahead)
    numbers, times = np.nonzero(inside)
    ranges = np.sqrt(squared[inside])
    if region.occluder_radius_m > 0.0 and len(hiding):
        origins = cameras[:, :3].take(times, 0)
        rays = (points.take(numbers, 0) - origins) / ranges[:, None]
        along = rays @ hiding.T
        along -= np.vecdot(rays, origins)[:, None]
        free = ~_hidden(region.occluder_radius_m, along, ranges, cameras[:, :3], times, hiding)
        numbers, times, ranges = numbers[free], times[free], ranges[free]
    return numbers, times, ranges


def _seen(cameras: Array, points: Array) -> Array:
    """(3, D, T) coordinates of points (D, 3) in the optical frames of cameras (T, 7)."""
    axes = so3.matrix(cameras[:, 3:]).transpose(2, 0, 1)  # (3, T, 3) each frame's x, then each one's y, and z
    origins = np.vecdot(axes, cameras[:, :3])
    return np.asarray(points @ np.swapaxes(axes, 1, 2) - origins[:, None])


def _hidden(radius_m: float, along: Array, ranges: Array, cameras: Array, times: Index, hiding: Array) -> Flags:
    """(L,) whether one of N balls about ``hiding`` (N, 3) occludes what is seen at ``times`` (L,), at ``ranges`` (L,).

    From ``cameras`` (T, 3); ``along`` (L, N) are the components along the rays of what leads to the balls' centres. A
    ray passes through a ball if its component is at least the length of the tangents from the camera.
    """
    squared = squared_norms(hiding - cameras[:, None])
    tangents = np.sqrt(np.maximum(squared - radius_m**2, 0.0))
    looks, balls = np.divmod(np.flatnonzero(along > tangents.take(times, 0)), len(hiding))
    behind = ranges[looks] > np.sqrt(squared[times[looks], balls]) + 2.0 * radius_m
    found = np.zeros(len(times), dtype=bool)
    found[looks[behind]] = True
    return found
