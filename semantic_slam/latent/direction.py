"""How a direction of view enters the networks: harmonics of the azimuth and a scaled elevation, with derivatives."""

import numpy as np
from numpy.typing import NDArray

from semantic_slam.viewpoint.model import Viewpoints

Array = NDArray[np.float64]

HARMONICS = 6
NUM_INPUTS = 2 * HARMONICS + 1
ELEVATION_MIDDLE_RAD = 0.25
ELEVATION_SCALE_RAD = 0.15

_ORDERS = np.arange(1, HARMONICS + 1)


def encoded(viewpoints: Viewpoints) -> Array:
    """(B, NUM_INPUTS): cosines, sines, elevation. Periodic in azimuth; range and roll do not enter."""
    turns = np.outer(viewpoints.azimuth_rad, _ORDERS)
    elevation = (np.asarray(viewpoints.elevation_rad) - ELEVATION_MIDDLE_RAD) / ELEVATION_SCALE_RAD
    return np.column_stack([np.cos(turns), np.sin(turns), elevation])


def encoded_derivative(viewpoints: Viewpoints) -> Array:
    """(B, NUM_INPUTS, 2) derivative of ``encoded`` by azimuth and elevation [1/rad]."""
    turns = np.outer(viewpoints.azimuth_rad, _ORDERS)
    derivative = np.zeros((len(turns), NUM_INPUTS, 2))
    derivative[:, :HARMONICS, 0] = -_ORDERS * np.sin(turns)
    derivative[:, HARMONICS : 2 * HARMONICS, 0] = _ORDERS * np.cos(turns)
    derivative[:, -1, 1] = 1.0 / ELEVATION_SCALE_RAD
    return derivative
