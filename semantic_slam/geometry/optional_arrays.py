"""Arrays of a dataclass that may be left out: NaN of the right shape once the object is made."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array


def left_out() -> Array:
    """An array without values: the default of one that may be left out."""
    return np.zeros(0)


def fill_left_out(owner: Any, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Replace those arrays of a frozen dataclass that were left out by NaN of ``shapes``; for ``__post_init__``."""
    for name, shape in shapes.items():
        if not getattr(owner, name).size:
            object.__setattr__(owner, name, np.full(shape, np.nan))
