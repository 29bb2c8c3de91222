"""One object seen from the robot, as a plain Python session states it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Range and bearing of an object's centre from the body's origin, or a bearing alone; x ahead, y to the left.

    Raises InputError for numbers that cannot be measurements.
    """

    bearing_rad: float  # counter-clockwise from x
    range_m: float | None = None  # None: not measured
    covariance: ArrayLike | None = None  # (2, 2) of [range, bearing]; None: perception.sigma_* of the configuration
    class_scores: Mapping[str, float] = field(default_factory=dict)  # class -> score; the class models' features
    score: float = 1.0  # of the detection itself; the best ones are used where there are more than objects
    track_id: str = ""  # identity of the object, for association: given
    label: str = ""  # what a detector calls it
    embedding: ArrayLike = ()  # appearance as a vector, of any length and unit; empty: none

    def __post_init__(self) -> None:
        numbers = {"bearing_rad": self.bearing_rad, "score": self.score, **dict(self.class_scores)}
        for name, value in numbers.items():
            if not math.isfinite(value):
                raise InputError(f"detection: {name} is {value}; leave detections out that have no such number")
        if self.range_m is not None and not (math.isfinite(self.range_m) and self.range_m > 0.0):
            raise InputError(f"detection: range_m is {self.range_m}; give metres above 0, or None for a bearing alone")
        if np.ndim(self.embedding) != 1 or not np.isfinite(np.asarray(self.embedding, dtype=np.float64)).all():
            raise InputError("detection: embedding must be one row of finite numbers; leave it out where there is none")
        if self.covariance is not None:
            positive_definite(self.covariance, 2, "detection: covariance of [range, bearing]")

    @classmethod
    def at(cls, x_m: float, y_m: float, *, covariance: ArrayLike | None = None, **others: Any) -> "Detection":
        """From a point in the body frame, with its (2, 2) covariance along x and y if known."""
        distance = math.hypot(x_m, y_m)
        if covariance is not None and distance > 0.0:
            by_point = np.array([[x_m, y_m], [-y_m / distance, x_m / distance]]) / distance
            covariance = by_point @ positive_definite(covariance, 2, "detection: covariance of [x, y]") @ by_point.T
        return cls(range_m=distance, bearing_rad=math.atan2(y_m, x_m), covariance=covariance, **others)

    def covariance_or_nan(self) -> Array:
        """(2, 2) of [range, bearing], NaN where nothing tells it."""
        if self.covariance is None:
            return np.full((2, 2), np.nan)
        known = np.array(self.covariance, dtype=np.float64)
        return known if self.range_m is not None else np.diag([np.nan, known[1, 1]])


def positive_definite(values: ArrayLike, size: int, what: str) -> Array:
    """(size, size) covariance; raises InputError that begins with ``what`` for anything else."""
    matrix = np.asarray(values, dtype=np.float64)
    if matrix.shape != (size, size) or not np.isfinite(matrix).all():
        raise InputError(f"{what} must be {size} x {size} finite numbers; correct it")
    if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix).min() <= 0.0:
        raise InputError(f"{what} is not symmetric and positive definite; give variances above 0 on its diagonal")
    return matrix
