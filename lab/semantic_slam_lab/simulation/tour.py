"""The ring of camera positions around the furniture, and the tour that the robot makes on it.

Views at a position are 30 degrees apart, so that a camera is (position on the ring, one of 12 headings).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array

STEP_M = 0.3
VIEWS_PER_POSITION = 12
RING_OFFSET_M = 1.65
"""Distance from the outer places of the grid to the ring [m]."""
RING_HALF_STEPS = (16, 9)
"""Half the ring's sides along x and y, in steps."""
HORIZONTAL_FOV_RAD = float(np.deg2rad(80.0))
CAMERA_HEIGHT_M = 0.9

SIGHT_RANGE_M = 4.5
OBJECT_RADIUS_M = 0.45
CORE_HALF_LENGTH_M = 2.4
LOOK_PATTERN = (0, 1, 0, -1)
"""Headings against the middle line, in views, in the order in which they take turns."""
POSITIONS_PER_LOOK = 12
KEYFRAME_EVERY = 2
LATEST_START = 6
"""Starts lie this many positions past the middle of the southern side, or fewer: from before the middle the robot
passes a whole row at once, and then its geometry alone tells where it is."""


@dataclass(frozen=True)
class TourFrame:
    """A camera of the tour."""

    position: int  # index on the ring, counter-clockwise
    view: int  # 0..11, counter-clockwise from map's x axis
    x_m: float
    y_m: float
    keyframe: bool

    @property
    def image(self) -> int:
        """Index of the image among all views of all positions."""
        return self.position * VIEWS_PER_POSITION + self.view

    @property
    def yaw_rad(self) -> float:
        return self.view * 2.0 * np.pi / VIEWS_PER_POSITION


def ring() -> Array:
    """(P, 2) positions in map, counter-clockwise from the middle of the southern side."""
    half_x, half_y = RING_HALF_STEPS
    south = [(x, -half_y) for x in range(-half_x, half_x)]
    east = [(half_x, y) for y in range(-half_y, half_y)]
    north = [(-x, -y) for x, y in south]
    west = [(-x, -y) for x, y in east]
    corners = south + east + north + west
    return STEP_M * np.array(corners[half_x:] + corners[:half_x], dtype=np.float64)


def tour(seed: int) -> tuple[TourFrame, ...]:
    """Frames once around, counter-clockwise, from a start that depends on the seed; the camera looks inwards.

    Every second position is a keyframe, and so is every view while the robot turns on the spot.
    """
    return tuple(frame for frame in drive(seed) if frame.keyframe)


def drive(seed: int) -> tuple[TourFrame, ...]:
    """The tour with the positions at which no keyframe is taken."""
    positions = ring()
    start = int(np.random.default_rng([seed, 2]).integers(0, LATEST_START + 1))
    frames: list[TourFrame] = []
    view = _look(positions[start], 0)
    for step in range(len(positions) + 1):
        index = (start + step) % len(positions)
        x, y = (float(value) for value in positions[index])
        wanted = _look(positions[index], step)
        turns = (wanted - view + VIEWS_PER_POSITION // 2) % VIEWS_PER_POSITION - VIEWS_PER_POSITION // 2
        frames.append(TourFrame(index, view, x, y, step % KEYFRAME_EVERY == 0))
        for _ in range(abs(turns)):
            view = (view + int(np.sign(turns))) % VIEWS_PER_POSITION
            frames.append(TourFrame(index, view, x, y, True))
    return tuple(frames)


def _look(position: Array, step: int) -> int:
    """View towards the middle line of the furniture, swung to and fro."""
    x, y = np.clip(position, [-CORE_HALF_LENGTH_M, 0.0], [CORE_HALF_LENGTH_M, 0.0]) - position
    inwards = round(float(np.arctan2(y, x)) / (2.0 * np.pi / VIEWS_PER_POSITION))
    swing = LOOK_PATTERN[step // POSITIONS_PER_LOOK % len(LOOK_PATTERN)]
    return (inwards + swing) % VIEWS_PER_POSITION


def sees(frame: TourFrame, places: Array) -> NDArray[np.bool_]:
    """(N,) which objects at ``places`` (N, 2) stand wholly in the picture, near enough and not behind another one."""
    offsets = places - np.array([frame.x_m, frame.y_m])
    distances = np.linalg.norm(offsets, axis=1)
    angles = np.arctan2(offsets[:, 1], offsets[:, 0]) - frame.yaw_rad
    angles = np.abs((angles + np.pi) % (2.0 * np.pi) - np.pi)
    inside = angles + np.arctan2(OBJECT_RADIUS_M, distances) < HORIZONTAL_FOV_RAD / 2.0
    return np.asarray(inside & (distances < SIGHT_RANGE_M) & ~_hidden(offsets, distances))


def _hidden(offsets: Array, distances: Array) -> NDArray[np.bool_]:
    """(N,) whether a nearer object stands in the line of sight; offsets (N, 2) from the camera."""
    directions = offsets / distances[:, None]
    along = directions @ offsets.T  # of the other object (column) on the ray to this one (row)
    beside = np.abs(directions[:, :1] * offsets[:, 1] - directions[:, 1:] * offsets[:, 0])
    nearer = (along > 0.0) & (along < distances[:, None] - OBJECT_RADIUS_M)
    return np.asarray((nearer & (beside < 1.3 * OBJECT_RADIUS_M)).any(axis=1))
