"""Tracks of the camera around an object."""

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.rendered.models import HALF_WIDTH_M
from semantic_slam_lab.studies.rendered.views import LEAST_RANGE_M

NUM_VIEWS = 10
STEP_M = 0.15
TURN_RAD = 0.35
"""Standard deviation of the change of heading from view to view."""
MARGIN_M = 0.1
"""Tracks stay this far inside the area that the class models were trained on."""
SEEN_FROM_Y_M = 0.5
"""The recoloured left side is in sight from where y is greater."""


def random_tracks(count: int, generator: np.random.Generator) -> Array:
    """(count, NUM_VIEWS, 2) smooth random walks on the side of the recoloured face."""
    found: list[Array] = []
    while len(found) < count:
        track = random_walk(generator)
        if np.all(inside(track)) and np.all(track[:, 1] > SEEN_FROM_Y_M):
            found.append(track)
    return np.stack(found)


def inside(locations_m: Array) -> NDArray[np.bool_]:
    """(...,) whether (..., 2) places lie in the trained area, with the margin."""
    far = np.abs(locations_m).max(axis=-1) <= HALF_WIDTH_M - MARGIN_M
    return np.asarray(far & (np.hypot(locations_m[..., 0], locations_m[..., 1]) >= LEAST_RANGE_M + MARGIN_M))


def random_walk(generator: np.random.Generator) -> Array:
    """One (NUM_VIEWS, 2) track that may lead anywhere."""
    start = generator.uniform(-HALF_WIDTH_M, HALF_WIDTH_M, 2)
    heading = generator.uniform(0.0, 2.0 * np.pi) + np.cumsum(generator.normal(0.0, TURN_RAD, NUM_VIEWS - 1))
    steps = STEP_M * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return np.asarray(start + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]))
