"""Broadcasting of states against repeated detections: with S detections, state b belongs to detection b mod S."""

from typing import Protocol, TypeVar

import numpy as np

from semantic_slam.geometry.arrays import Array, broadcast_copy
from semantic_slam.geometry.rows import Dataclass, take


class Detections(Dataclass, Protocol):
    """Detections as arrays of one row each."""

    @property
    def range_m(self) -> Array:
        """(S,) metres."""


Table = TypeVar("Table", bound=Detections)


def per_detection(values: Array, count: int) -> Array:
    """(B / S, S, ...) view of (B, ...) rows by detection; S is ``count``."""
    return values.reshape(len(values) // max(count, 1), count, *values.shape[1:])


def repeated(values: Array, count: int) -> Array:
    """(count, p) rows: the (S, p) rows of the detections, tiled."""
    shape = (count // max(len(values), 1), *values.shape)
    return broadcast_copy(values, shape).reshape(-1, *values.shape[1:])


def repeated_detections(detections: Table, count: int) -> Table:
    """(count,) detections: the S ``detections``, tiled."""
    number = len(detections.range_m)
    return detections if number == count else take(detections, np.arange(count) % max(number, 1))
