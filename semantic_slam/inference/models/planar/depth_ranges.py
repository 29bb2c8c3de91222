"""Ranges that are depths along a sensor's axis: conversion to distances, and the ground area that depths cover.

Beyond :data:`WIDEST_RAD` off the axis ranges are taken to be distances.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array

WIDEST_RAD = 1.2
"""Angle off the axis up to which ranges are depths: no lens maps a plane beyond it."""


def distance_per_depth(off_axis_rad: Array) -> Array:
    """(...,) ratio of distance to depth, by angles off the axis in [-pi, pi)."""
    off = np.abs(off_axis_rad)
    return np.where(off < WIDEST_RAD, 1.0 / np.cos(np.minimum(off, WIDEST_RAD)), 1.0)


def covered(off_axis_rad: Array) -> Array:
    """(...,) twice the area between the axis and an angle off it at a depth of 1; negative to the right."""
    off = np.abs(off_axis_rad)
    beyond = np.maximum(off - WIDEST_RAD, 0.0)
    return np.asarray(np.sign(off_axis_rad) * (np.tan(np.minimum(off, WIDEST_RAD)) + beyond))


def off_axis(area: Array) -> Array:
    """(...,) angle at which :func:`covered` has the given value."""
    size, most = np.abs(area), np.tan(WIDEST_RAD)
    return np.asarray(np.sign(area) * (np.arctan(np.minimum(size, most)) + np.maximum(size - most, 0.0)))
