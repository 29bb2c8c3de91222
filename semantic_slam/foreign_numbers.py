"""Numbers given through the Python interface, which may be of any type."""

import math
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array


def as_numbers(values: Any) -> Array:
    """Values as float64 of their own shape; where they are text, ragged or no numbers a single NaN, of shape ()."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.array(np.nan)


def is_finite(value: Any) -> bool:
    """Whether ``value`` is one finite number."""
    try:
        return math.isfinite(value)
    except (TypeError, ValueError, OverflowError):
        return False
