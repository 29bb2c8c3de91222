"""Input maps of class models: from the camera's 2-D location relative to the object to GP inputs."""

from collections.abc import Callable

import numpy as np

from semantic_slam.geometry.arrays import Array


def location(relative_m: Array) -> Array:
    """(..., 2) relative location [m], unchanged."""
    return relative_m


def unit_circle(relative_m: Array) -> Array:
    """(..., 2) location projected to the unit circle: only the viewing direction matters (Eq. 3.47)."""
    azimuth = np.arctan2(relative_m[..., 1], relative_m[..., 0])
    return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)


def polar(relative_m: Array) -> Array:
    """(..., 3) range [m] and the azimuth as a point on the unit circle, so that a kernel is periodic in it."""
    return np.concatenate([np.linalg.norm(relative_m, axis=-1, keepdims=True), unit_circle(relative_m)], axis=-1)


INPUT_MAPS: dict[str, Callable[[Array], Array]] = {"location": location, "unit_circle": unit_circle, "polar": polar}
"""Name -> map; the length matrices L of a class model are in the units of its result."""
