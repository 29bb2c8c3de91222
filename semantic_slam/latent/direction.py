"""Encoding of viewing directions for the networks: azimuth harmonics and a scaled elevation, with derivatives."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.model import Viewpoints

HARMONICS = 6
NUM_INPUTS = 2 * HARMONICS + 1
ELEVATION_MIDDLE_RAD = 0.25
ELEVATION_SCALE_RAD = 0.15

_ORDERS = np.arange(1, HARMONICS + 1)


def encoded(viewpoints: Viewpoints) -> Array:
    """(B, NUM_INPUTS) encoding: cosines, sines, elevation. Periodic in azimuth; independent of range and roll."""
    turns = viewpoints.azimuth_rad[:, None] * _ORDERS
    return _joined(np.cos(turns), np.sin(turns), viewpoints.elevation_rad)


def encoded_with_derivative(viewpoints: Viewpoints) -> tuple[Array, Array]:
    """``encoded`` and its (B, 2, NUM_INPUTS) derivative by azimuth and elevation [1/rad]."""
    turns = viewpoints.azimuth_rad[:, None] * _ORDERS
    cos, sin = np.cos(turns), np.sin(turns)
    derivative = np.zeros((len(turns), 2, NUM_INPUTS))
    derivative[:, 0, :HARMONICS] = -_ORDERS * sin
    derivative[:, 0, HARMONICS : 2 * HARMONICS] = _ORDERS * cos
    derivative[:, 1, -1] = 1.0 / ELEVATION_SCALE_RAD
    return _joined(cos, sin, viewpoints.elevation_rad), derivative


def _joined(cos: Array, sin: Array, elevation_rad: Array) -> Array:
    elevation = (elevation_rad - ELEVATION_MIDDLE_RAD) / ELEVATION_SCALE_RAD
    return np.concatenate([cos, sin, elevation[:, None]], axis=1)
