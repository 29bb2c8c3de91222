"""Edges at which a box ends before its object does: at the image border, and where something nearer hides the rest.

An edge is cut by an occluder where nearer surfaces stand just outside most of it. A depth image tells that: at the edge
there is a step from the surface inside to a nearer one outside, which is nearer than the object, too. Both surfaces are
continued towards the edge as planes, so that a floor or a table on which the object stands has no step there, however
fast it comes nearer below. The inverse depth of a plane is linear in the pixel. Without depth nothing tells which of
two things hides the other.

An edge has to be covered along its length: an object that shows beside its occluder reaches the edge of its box there.
"""

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.range_bearing import depth_in_box

BORDER_PX = 2.0
"""Distance [px] to the image border below which a box counts as cut by it."""
PROBES = (np.arange(8) + 0.5) / 8.0
"""Where along an edge its two sides are looked at, as fractions of its length."""
LEAST_COVERED = 0.75
"""Smallest share of the probes of a cut edge outside which something nearer stands."""
OUTSIDE, INSIDE, LEAST_PX = 0.05, 0.1, 3.0
"""Distances of the probes from the edge as shares of the side across it, and the smallest distance [px].

Two readings, at this distance and twice as far away, tell the plane through them. Detectors place edges to some 5 % of
a side: so the plane outside is continued that far beyond the edge, to where the object may end already. Inside, where
the object goes on, the readings are taken farther from the edge, and the plane is continued to it.
"""
LEAST_STEP_M, STEP_PER_M = 0.1, 0.05
"""Smallest step in depth from an object to its occluder [m], and per metre of depth, as depth errs by more far away."""
FARTHEST_M = 1e3
"""Depth of a plane that does not meet the edge before the camera."""


def cut_by_border(boxes: Array, camera: CameraModel) -> Flags:
    """(D, 2, 2) which edges of (D, 4) boxes the image border cuts; axis 1 is x and y, axis 2 the low and high end."""
    size = np.array([camera.width, camera.height])
    return np.stack([boxes[:, :2] < BORDER_PX, boxes[:, 2:] > size - BORDER_PX], axis=2)


def none_cut(count: int) -> Flags:
    """(count, 2, 2) of boxes that nothing cuts."""
    return np.zeros((count, 2, 2), dtype=np.bool_)


def cut_edges(
    boxes: Array, camera: CameraModel, depth_m: NDArray[np.float32] | None, max_depth_m: float = np.inf
) -> Flags:
    """(D, 2, 2) which edges of (D, 4) boxes are cut, by the border or by what is nearer; none where there is no box.

    ``depth_m`` is (height, width) along the optical axis [m]; None: no depth. Axis 1 is x and y, axis 2 the low and
    high end.
    """
    at_border = cut_by_border(boxes, camera)
    if depth_m is None:
        return at_border
    depths = np.array([_depth_of(box, depth_m, max_depth_m) for box in boxes], dtype=np.float64)
    outwards = np.array([-1.0, 1.0])
    here = _depths_beside(boxes, -INSIDE * outwards, depth_m, beyond=0.0)
    there = _depths_beside(boxes, OUTSIDE * outwards, depth_m, beyond=1.0)
    covered = _is_nearer(there, np.fmin(depths[:, None, None, None], here))
    return np.asarray(at_border | (covered.mean(axis=-1) >= LEAST_COVERED))


def _depth_of(box: Array, depth_m: NDArray[np.float32], max_depth_m: float) -> float:
    return depth_in_box(depth_m, box, max_depth_m) if np.isfinite(box).all() else float("nan")


def _is_nearer(there: Array, own: Array) -> Flags:
    """Whether depths are nearer than ``own`` by a step; False where either is NaN."""
    return np.asarray(own - there > np.maximum(LEAST_STEP_M, STEP_PER_M * own))


def _depths_beside(boxes: Array, away: Array, depth_m: NDArray[np.float32], *, beyond: float) -> Array:
    """(D, 2, 2, P) depth of the surfaces ``away`` from the edges; NaN where the nearer of two readings is missing.

    The surfaces are continued as planes to ``beyond`` the edges, in units of ``away``; where the farther reading is
    missing, their depth is that of the nearer one.
    """
    near, far = (_readings(_probes(boxes, away, times), depth_m) for times in (1.0, 2.0))
    inverse = np.where(np.isfinite(far), (2.0 + beyond) / near - (1.0 + beyond) / far, 1.0 / near)
    return 1.0 / np.where(inverse <= 0.0, 1.0 / FARTHEST_M, inverse)


def _probes(boxes: Array, away: Array, times: float) -> Array:
    """(D, 2, 2, P, 2) pixels beside the edges, ``times`` as far as ``away`` (2,), shares of the side across."""
    sides = boxes[:, 2:] - boxes[:, :2]
    along = boxes[:, None, :2] + PROBES[:, None] * sides[:, None]  # (D, P, 2)
    edges = np.stack([boxes[:, :2], boxes[:, 2:]], axis=2)  # (D, 2, 2)
    shifts = np.sign(away) * np.maximum(np.abs(away) * sides[:, :, None], LEAST_PX)
    pixels = np.tile(along[:, None, None], (1, 2, 2, 1, 1))
    for axis in range(2):
        pixels[:, axis, :, :, axis] = (edges + times * shifts)[:, axis, :, None]
    return pixels


def _readings(pixels: Array, depth_m: NDArray[np.float32]) -> Array:
    """(...,) depth at (..., 2) pixels; NaN outside the image and without a valid reading."""
    height, width = depth_m.shape
    is_inside = np.asarray(((pixels >= 0.0) & (pixels < [width, height])).all(axis=-1))
    u, v = np.moveaxis(np.where(is_inside[..., None], pixels, 0.0).astype(np.intp), -1, 0)
    found = depth_m[v, u].astype(np.float64)
    return np.where(is_inside & np.isfinite(found) & (found > 0.0), found, np.nan)
