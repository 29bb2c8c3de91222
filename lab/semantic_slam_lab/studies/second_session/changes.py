"""What changes in a room between two sessions: two objects are moved, one is gone, one is new."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam_lab.simulation.furniture import MODELS
from semantic_slam_lab.simulation.layout import draw_layout
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject
from semantic_slam_lab.simulation.tour import sees, tour

MOVED_M = (0.6, 1.2)
TURNED_RAD = 0.6
CLEAR_M = 1.1
"""Between the middles of two pieces."""
FREE = np.array([3.9, 1.7])
"""Half the sides of the ground inside the robot's ring on which furniture may stand."""
LEAST_SIGHTS = 5
"""Keyframes that see what changed: what is hardly seen cannot be found out."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """The room at the second session, and what changed, by the numbers of the furniture."""

    objects: tuple[PlacedObject, ...]
    moved: frozenset[int]
    gone: int
    new: int


def changed(seed: int) -> Change:
    """The change of a room. What changed is of four classes: of identical twins nobody can tell which was moved."""
    random, before = np.random.default_rng([seed, 31]), draw_layout(seed)
    while True:
        drawn = _drawn(before, random)
        if _are_of_four_classes(drawn, before) and _are_clear(drawn.objects) and _are_seen(drawn, before, seed):
            return drawn


def _drawn(before: tuple[PlacedObject, ...], random: np.random.Generator) -> Change:
    first, second, gone = (before[row] for row in random.permutation(len(before))[:3].tolist())
    name = str(random.choice(sorted(MODELS)))
    x, y = random.uniform(-FREE, FREE).tolist()
    number = 1 + max(own.object_id for own in before)
    new = PlacedObject(number, f"{name}_new", name, x, y, float(random.uniform(-np.pi, np.pi)))
    kept = [own for own in before if own not in (first, second, gone)]
    objects = (*kept, _moved(first, random), _moved(second, random), new)
    return Change(
        objects=objects, moved=frozenset((first.object_id, second.object_id)), gone=gone.object_id, new=number
    )


def _moved(own: PlacedObject, random: np.random.Generator) -> PlacedObject:
    distance, direction = random.uniform(*MOVED_M), random.uniform(-np.pi, np.pi)
    return replace(
        own,
        x_m=own.x_m + float(distance * np.cos(direction)),
        y_m=own.y_m + float(distance * np.sin(direction)),
        yaw_rad=float(wrap_angle(np.array(own.yaw_rad + random.uniform(-TURNED_RAD, TURNED_RAD)))),
    )


def _are_of_four_classes(drawn: Change, before: tuple[PlacedObject, ...]) -> bool:
    numbers = {*drawn.moved, drawn.gone}
    own = [item.class_name for item in before if item.object_id in numbers]
    return len({*own, drawn.objects[-1].class_name}) == len(own) + 1


def _places(objects: tuple[PlacedObject, ...]) -> Array:
    return np.array([[own.x_m, own.y_m] for own in objects])


def _are_clear(objects: tuple[PlacedObject, ...]) -> bool:
    places = _places(objects)
    apart = np.linalg.norm(places[:, None] - places, axis=-1) + 10.0 * np.eye(len(places))
    return bool(apart.min() > CLEAR_M and (np.abs(places) < FREE).all())


def _are_seen(drawn: Change, before: tuple[PlacedObject, ...], seed: int) -> bool:
    """Whether the tour sees what is moved and new, and the place of what is gone."""
    was = next(own for own in before if own.object_id == drawn.gone)
    objects = (*drawn.objects, was)
    counts = np.sum([sees(frame, _places(objects)) for frame in tour(seed)], axis=0)
    wanted = [own.object_id in {*drawn.moved, drawn.new, drawn.gone} for own in objects]
    return bool((counts[np.array(wanted)] >= LEAST_SIGHTS).all())
