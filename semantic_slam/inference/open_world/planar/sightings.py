"""Likelihood of the detections of objects, and of their misses while in view, along a known path.

For proposals of histories; the engine's own account of misses is computed by the replay.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.open_world.existence import LEAST_DETECTION_SHARE
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.states.detection_rates import DetectionRates

PLACE_SIGMA_M = 0.1
"""Standard deviation [m] of an object relative to the path, which softens the edge of the region."""


@dataclass(frozen=True, kw_only=True)
class Sightings:
    """T keyframes, and P sensor settings."""

    path: Array  # (T, 3)
    regions: Sequence[SensorRegion]  # T
    sensors: DetectionRates  # P

    def in_view(self, points: Array) -> Array:
        """(..., T, P) detection probability of points (..., 2) in the path's frame, relative to that at the sensor."""
        spread = PLACE_SIGMA_M**2 * np.eye(2)
        found = np.zeros((*points.shape[:-1], len(self.path), len(self.sensors)))
        poses = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
        for k, (pose, region) in enumerate(zip(self.path, self.regions, strict=True)):
            relative = se2.between(np.broadcast_to(pose, poses.shape), poses)[..., :2]
            inside = region.contains(relative, np.broadcast_to(spread, (*relative.shape[:-1], 2, 2)))
            seen = inside[..., None] * self.sensors.fall_off(np.hypot(relative[..., 0], relative[..., 1]))
            found[..., k, :] = self.sensors.by_direction.times(seen, relative, region.direction_rad)
        return found

    def log_likelihoods(self, in_view: Array, detected: Flags, first: Index) -> Array:
        """(..., P) log likelihood of being ``detected`` (..., T) or missed after keyframe ``first`` (...,); -1: in all.

        ``in_view`` is (..., T, P).
        """
        runs = self.sensors.runs
        hit, share, persistence = runs.hit, runs.share, runs.persistence
        least = LEAST_DETECTION_SHARE * hit * share
        known = np.broadcast_to(share, (*first.shape, len(share))).copy()
        total = np.zeros(known.shape)
        for k in range(in_view.shape[-2]):
            begun, seen = np.asarray(k > first)[..., None], detected[..., k, None]
            now = in_view[..., k, :] * hit * known
            log_seen = np.log(np.maximum(now, least))
            total += np.where(begun, np.where(seen, log_seen, np.log1p(-np.minimum(now, 1.0 - 1e-9))), 0.0)
            after = np.where(seen | np.asarray(k == first)[..., None], 1.0, (known - now) / np.maximum(1.0 - now, 1e-9))
            known = np.where(k >= first[..., None], share + persistence * (after - share), known)
        return total
