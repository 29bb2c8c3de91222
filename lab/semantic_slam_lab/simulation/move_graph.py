"""Which image a robot reaches by turning or by one step, as AVD's annotations link them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.simulation.tour import STEP_M, VIEWS_PER_POSITION

STEPS = {"forward": 0.0, "left": np.pi / 2.0, "backward": np.pi, "right": -np.pi / 2.0}
"""Direction of each step against the camera's heading, counter-clockwise."""
LONGEST_STEP_M = 1.2 * STEP_M
DIRECTION_TOLERANCE_RAD = float(np.deg2rad(31.0))


def moves(names: Sequence[str], positions: Array) -> list[dict[str, str]]:
    """Links of every image; ``names[p * VIEWS_PER_POSITION + v]`` is view v (counter-clockwise) at ``positions[p]``."""
    neighbours = [_neighbours(index, positions) for index in range(len(positions))]
    return [_links(image, names, positions, neighbours) for image in range(len(names))]


def _links(
    image: int, names: Sequence[str], positions: Array, neighbours: Sequence[NDArray[np.int_]]
) -> dict[str, str]:
    position, view = divmod(image, VIEWS_PER_POSITION)
    links = {
        "rotate_ccw": names[position * VIEWS_PER_POSITION + (view + 1) % VIEWS_PER_POSITION],
        "rotate_cw": names[position * VIEWS_PER_POSITION + (view - 1) % VIEWS_PER_POSITION],
    }
    heading = view * 2.0 * np.pi / VIEWS_PER_POSITION
    for move, direction in STEPS.items():
        target = _nearest_in_direction(positions, position, neighbours[position], heading + direction)
        links[move] = "" if target is None else names[target * VIEWS_PER_POSITION + view]
    return links


def _neighbours(index: int, positions: Array) -> NDArray[np.int_]:
    """Other positions within one step."""
    distances = np.linalg.norm(positions - positions[index], axis=1)
    return np.flatnonzero((distances > 0.0) & (distances < LONGEST_STEP_M))


def _nearest_in_direction(positions: Array, index: int, neighbours: NDArray[np.int_], direction: float) -> int | None:
    """The neighbour that deviates least from the direction [rad], None when all deviate too much."""
    offsets = positions[neighbours] - positions[index]
    deviations = np.abs(np.angle(np.exp(1j * (np.arctan2(offsets[:, 1], offsets[:, 0]) - direction))))
    if not len(deviations) or deviations.min() > DIRECTION_TOLERANCE_RAD:
        return None
    return int(neighbours[np.argmin(deviations)])
