"""Pictures in which no object stands: independent pixels, and coloured blocks."""

import numpy as np

from semantic_slam.geometry.arrays import Bytes

MOST_BLOCKS = 5
LEAST_SIDE = 8
"""Shorter side of a block [px]."""


def noise(size: int, generator: np.random.Generator) -> Bytes:
    """(size, size, 3) picture of independent uniform pixels."""
    return generator.integers(0, 256, (size, size, 3), dtype=np.uint8)


def coloured_blocks(size: int, generator: np.random.Generator) -> Bytes:
    """(size, size, 3) picture of one colour with fewer than :data:`MOST_BLOCKS` rectangles of others."""
    picture = np.full((size, size, 3), generator.integers(0, 256, 3), dtype=np.uint8)
    for _ in range(generator.integers(0, MOST_BLOCKS)):
        x, y = np.sort(generator.integers(0, size, (2, 2)), axis=1)
        picture[y[0] : y[1] + LEAST_SIDE, x[0] : x[1] + LEAST_SIDE] = generator.integers(0, 256, 3)
    return picture
