"""Optional array fields of dataclasses: a field left out becomes NaN of the right shape on construction."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array


def left_out() -> Array:
    """Empty array, the default value of an optional array field."""
    return np.zeros(0)


def fill_left_out(owner: Any, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Set the array fields of a frozen dataclass that were left out to NaN of ``shapes``; for ``__post_init__``."""
    for name, shape in shapes.items():
        if not getattr(owner, name).size:
            object.__setattr__(owner, name, np.full(shape, np.nan))
