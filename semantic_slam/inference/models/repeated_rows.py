"""Broadcasting of states against repeated detections: with S detections, state b belongs to detection b mod S."""

from semantic_slam.geometry.arrays import Array, broadcast_copy


def per_detection(values: Array, count: int) -> Array:
    """(B / S, S, ...) view of (B, ...) rows by detection; S is ``count``."""
    return values.reshape(len(values) // max(count, 1), count, *values.shape[1:])


def repeated(values: Array, count: int) -> Array:
    """(count, p) rows: the (S, p) rows of the detections, tiled."""
    shape = (count // max(len(values), 1), *values.shape)
    return broadcast_copy(values, shape).reshape(-1, *values.shape[1:])
