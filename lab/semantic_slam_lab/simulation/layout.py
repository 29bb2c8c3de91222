"""Where the furniture stands: a nearly regular grid, whose places only differ in heading and class.

Geometry alone cannot tell one part of such a grid from another; the headings are drawn so that a shifted copy of the
grid never fits what a robot sees of the objects' fronts, sides and backs.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam_lab.simulation.furniture import MODELS
from semantic_slam_lab.simulation.goods import CLASSES, goods_names
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, Room
from semantic_slam_lab.simulation.tour import RING_OFFSET_M, TourFrame, sees, tour

COLUMNS, ROWS = 4, 2
SPACING_M = 2.1
JITTER_M = 0.06
HEADING_JITTER_RAD = 0.2
WALL_DISTANCE_M = 1.6
DRAWS = 2000
FRONT_RAD = 0.9
"""An object counts as seen from the front within this azimuth."""


def draw_layout(seed: int, goods: int = 0) -> tuple[PlacedObject, ...]:
    """Eight objects in the best of ``DRAWS`` sets of headings: every class of furniture at least once and three twice.

    With ``goods`` two different instances of each of four classes instead, out of the first so many goods.
    """
    rng = np.random.default_rng([seed, 1])
    places = grid() + rng.uniform(-JITTER_M, JITTER_M, (COLUMNS * ROWS, 2))
    frames = tour(seed)
    bearings = np.arctan2(frames_xy(frames)[:, None, 1] - places[:, 1], frames_xy(frames)[:, None, 0] - places[:, 0])
    visible = np.array([sees(frame, places) for frame in frames])
    candidates = [_headings(rng) for _ in range(DRAWS)]
    headings = max(candidates, key=lambda drawn: _merit(drawn, bearings, visible))
    return _placed(places, headings, _goods(rng, goods) if goods else _classes(rng))


def grid() -> Array:
    """(N, 2) regular places in map, whose origin is the middle of the grid."""
    columns = (np.arange(COLUMNS) - (COLUMNS - 1) / 2.0) * SPACING_M
    rows = (np.arange(ROWS) - (ROWS - 1) / 2.0) * SPACING_M
    return np.array([[x, y] for y in rows for x in columns])


def room() -> Room:
    """Walls around the ring on which the robot drives."""
    x, y = np.abs(grid()).max(axis=0) + RING_OFFSET_M + WALL_DISTANCE_M
    return Room(-x, -y, x, y)


def frames_xy(frames: Sequence[TourFrame]) -> Array:
    """(F, 2) positions of the frames in map [m]."""
    return np.array([[frame.x_m, frame.y_m] for frame in frames])


def _headings(rng: np.random.Generator) -> Array:
    count = COLUMNS * ROWS
    return rng.integers(0, 4, count) * (np.pi / 2.0) + rng.uniform(-HEADING_JITTER_RAD, HEADING_JITTER_RAD, count)


def _merit(headings: Array, bearings: Array, visible: NDArray[np.bool_]) -> float:
    """How badly the best shifted copy fits; nothing that is never seen from the front three times may win."""
    azimuths = wrap_angle(bearings - headings)
    fronts = (visible & (np.abs(azimuths) < FRONT_RAD)).sum(axis=0)
    return _distinctness(headings) - 10.0 * float(np.maximum(3 - fronts, 0).sum())


def _distinctness(headings: Array) -> float:
    """Least mean difference (1 - cos) / 2 between the headings and those of a copy shifted by whole places."""
    table = headings.reshape(ROWS, COLUMNS)
    differences = []
    for row in range(ROWS):
        for column in range(-COLUMNS + 2, COLUMNS - 1):
            if row == 0 and column <= 0:
                continue  # no shift, or the mirror image of one that counts
            first = table[row:, max(column, 0) : COLUMNS + min(column, 0)]
            second = table[: ROWS - row, max(-column, 0) : COLUMNS + min(-column, 0)]
            differences.append(float(np.mean(1.0 - np.cos(first - second)) / 2.0))
    return min(differences)


def _classes(rng: np.random.Generator) -> list[str]:
    names = sorted(MODELS)
    twice = rng.choice(names, COLUMNS * ROWS - len(names), replace=False).tolist()
    return [str(name) for name in rng.permutation(names + twice)]


def _goods(rng: np.random.Generator, count: int) -> list[str]:
    names = goods_names(count)
    classes = rng.choice(sorted(CLASSES), COLUMNS * ROWS // 2, replace=False).tolist()
    pairs = [rng.choice([n for n in names if n.startswith(f"{name}_")], 2, replace=False) for name in classes]
    return [str(name) for name in rng.permutation(np.concatenate(pairs))]


def _placed(places: Array, headings: Array, classes: Sequence[str]) -> tuple[PlacedObject, ...]:
    """Instances, numbered by model and place; ids from 1 because 0 is AVD's background."""
    order = sorted(range(len(classes)), key=lambda index: (classes[index], index))
    objects = []
    for number, index in enumerate(order, start=1):
        instance = sum(classes[other] == classes[index] for other in order[:number])
        name = f"{classes[index]}_{instance}"
        x, y = places[index]
        objects.append(
            PlacedObject(number, name, classes[index], float(x), float(y), float(wrap_angle(headings[index])))
        )
    return tuple(objects)
