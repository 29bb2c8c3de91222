"""Tracks around objects, along photographs that no model was fitted to."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.real_turntables.lookalikes import Draw
from semantic_slam_lab.studies.real_turntables.photographs import Photographs

NUM_VIEWS = 12
LEAST_STEP_DEG, LARGEST_STEP_DEG = 15.0, 35.0
"""Between two views of a track, drawn evenly."""
RANGE_M = 1.0
"""The photographs are cut to the object: a camera on a circle of this radius."""
TRACKS_PER_OBJECT = 2


@dataclass(frozen=True)
class Track:
    """One object seen from K places."""

    true_class: int  # in its draw
    rows: Index  # (K,) of the photographs
    cluttered: Flags  # (K,) half of them stand in a room
    places_m: Array  # (K, 2) camera in the object's frame


def tracks_of(photographs: Photographs, draw: Draw, seed: int) -> list[Track]:
    """TRACKS_PER_OBJECT about each object of a draw, from any direction, either way round."""
    return [
        _track(photographs, draw, index, keyed_generator("real_turntables", "track", seed, draw.number, index, turn))
        for index in range(len(draw.names))
        for turn in range(TRACKS_PER_OBJECT)
    ]


def _track(photographs: Photographs, draw: Draw, index: int, generator: np.random.Generator) -> Track:
    rows = photographs.others(draw.names[index])
    steps = np.cumsum(np.deg2rad(generator.uniform(LEAST_STEP_DEG, LARGEST_STEP_DEG, NUM_VIEWS)))
    wanted = generator.uniform(0.0, 2.0 * np.pi) + generator.choice([-1.0, 1.0]) * steps
    away = np.abs(wrap_angle(photographs.azimuth_rad[rows][None] - wanted[:, None]))
    chosen = rows[away.argmin(axis=1)]
    cluttered = generator.permutation(NUM_VIEWS) < NUM_VIEWS // 2
    azimuth = photographs.azimuth_rad[chosen]
    return Track(index, chosen, cluttered, RANGE_M * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1))
