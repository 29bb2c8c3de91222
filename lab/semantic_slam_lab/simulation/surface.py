"""Textured surfaces that simulated objects are put together from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array

SEGMENTS = 48
"""Number of segments around a surface of revolution."""


@dataclass(frozen=True)
class Surface:
    """A triangle mesh with a picture on it, in the object frame, metres."""

    name: str
    picture: str
    vertices: Array  # (V, 3)
    texture: Array  # (V, 2) place in the picture, 0..1 from its upper left corner
    triangles: NDArray[np.int_]  # (T, 3) counter-clockwise from outside


def rectangle(name: str, picture: str, centre: Sequence[float], right: Sequence[float], up: Sequence[float]) -> Surface:
    """A rectangle by its centre and half extents, its picture upright for who looks at it from outside."""
    middle, half_right, half_up = np.array(centre), np.array(right), np.array(up)
    corners = np.array(
        [
            middle - half_right - half_up,
            middle + half_right - half_up,
            middle + half_right + half_up,
            middle - half_right + half_up,
        ]
    )
    texture = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    return Surface(name, picture, corners, texture, np.array([[0, 1, 2], [0, 2, 3]]))


def revolved(name: str, picture: str, profile: Array) -> Surface:
    """The (P, 2) radii and heights of ``profile``, from the bottom up, turned about z.

    The picture is wrapped around: its middle column lies at +x, its right half goes to the object's left (+y).
    """
    turns = np.linspace(-np.pi, np.pi, SEGMENTS + 1)
    radius, height = profile[:, 0], profile[:, 1]
    vertices = np.stack(
        [
            radius[:, None] * np.cos(turns),
            radius[:, None] * np.sin(turns),
            np.broadcast_to(height[:, None], (len(profile), SEGMENTS + 1)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    across = np.broadcast_to(np.linspace(0.0, 1.0, SEGMENTS + 1), (len(profile), SEGMENTS + 1))
    down = 1.0 - (height - height[0]) / (height[-1] - height[0])
    texture = np.stack([across, np.broadcast_to(down[:, None], across.shape)], axis=-1).reshape(-1, 2)
    return Surface(name, picture, vertices, texture, _strip_triangles(len(profile), SEGMENTS + 1))


def disc(name: str, picture: str, radius: float, height: float) -> Surface:
    """A horizontal disc seen from above; the upper edge of its picture points to -x, as on a box's lid."""
    turns = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    ring = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    flat = np.concatenate([[[0.0, 0.0]], ring])
    vertices = np.column_stack([radius * flat, np.full(len(flat), height)])
    texture = 0.5 + 0.5 * flat[:, ::-1]
    around = np.arange(SEGMENTS)
    triangles = np.stack([np.zeros(SEGMENTS, dtype=int), 1 + around, 1 + (around + 1) % SEGMENTS], axis=1)
    return Surface(name, picture, vertices, texture, triangles)


def _strip_triangles(rows: int, columns: int) -> NDArray[np.int_]:
    """(T, 3) triangles of a grid of vertices."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    return np.concatenate([lower, upper])
