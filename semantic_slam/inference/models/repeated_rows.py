"""Rows of states beside detections that repeat: of S detections state b is of detection b mod S."""

from semantic_slam.geometry.arrays import Array, broadcast_copy


def per_detection(values: Array, count: int) -> Array:
    """(B / S, S, ...) rows by detection of (B, ...), S being ``count``."""
    return values.reshape(len(values) // max(count, 1), count, *values.shape[1:])


def repeated(values: Array, count: int) -> Array:
    """(S, p) of the detections as (count, p)."""
    shape = (count // max(len(values), 1), *values.shape)
    return broadcast_copy(values, shape).reshape(-1, *values.shape[1:])
