"""Detections of a sensor that tells places in the body frame, without pictures."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import Detections


def told_places(stamp_ns: int, ranges_m: Array, bearings_rad: Array, variances: tuple[float, float]) -> Detections:
    """Boxes at (D,) ranges and bearings; ``variances`` of a range [m^2] and of a bearing [rad^2]."""
    count = len(ranges_m)
    return Detections(
        stamp_ns=stamp_ns,
        frame_id="base_link",
        boxes=np.full((count, 4), np.nan),
        labels=("box",) * count,
        scores=np.full(count, 0.9),
        track_ids=("",) * count,
        ranges_m=ranges_m,
        bearings_rad=bearings_rad,
        elevations_rad=np.zeros(count),
        place_covariances=np.tile(np.diag([*variances, np.nan]), (count, 1, 1)),
    )
