"""How likely it is that objects were detected when they were, and missed when they were in view and were not.

For histories that are proposed: the path is taken as known. What the engine makes of misses, the replay tells.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.miss_runs import MissRuns
from semantic_slam.inference.open_world.existence_accounts import LEAST_DETECTION_SHARE
from semantic_slam.inference.open_world.sensor_region import SensorRegion

PLACE_SIGMA_M = 0.1
"""Standard deviation of an object beside the path: the edge of the region is as soft."""


@dataclass(frozen=True, kw_only=True)
class Sightings:
    """T keyframes, and P detection probabilities that the sensor may have."""

    path: Array  # (T, 3)
    regions: Sequence[SensorRegion]  # T
    chains: Sequence[MissRuns]  # P

    def in_view(self, points: Array) -> Array:
        """(..., T) probability that points (..., 2) are in the region, in the frame of the path."""
        spread = PLACE_SIGMA_M**2 * np.eye(2)
        found = np.zeros((*points.shape[:-1], len(self.path)))
        poses = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
        for k, (pose, region) in enumerate(zip(self.path, self.regions, strict=True)):
            relative = se2.between(np.broadcast_to(pose, poses.shape), poses)[..., :2]
            found[..., k] = region.contains(relative, np.broadcast_to(spread, (*relative.shape[:-1], 2, 2)))
        return found

    def log_likelihoods(self, in_view: Array, detected: Flags, first: Index) -> Array:
        """(..., P) of ``detected`` (..., T) and missed, from the keyframe after ``first`` (...,) on; -1: from all."""
        hit = np.array([chain.hit for chain in self.chains])
        share = np.array([chain.share for chain in self.chains])
        persistence = np.array([chain.persistence for chain in self.chains])
        least = LEAST_DETECTION_SHARE * hit * share
        known = np.broadcast_to(share, (*first.shape, len(share))).copy()
        total = np.zeros(known.shape)
        for k in range(in_view.shape[-1]):
            begun, seen = np.asarray(k > first)[..., None], detected[..., k, None]
            now = in_view[..., k, None] * hit * known
            log_seen = np.log(np.maximum(now, least))
            total += np.where(begun, np.where(seen, log_seen, np.log1p(-np.minimum(now, 1.0 - 1e-9))), 0.0)
            after = np.where(seen | np.asarray(k == first)[..., None], 1.0, (known - now) / np.maximum(1.0 - now, 1e-9))
            known = np.where(k >= first[..., None], share + persistence * (after - share), known)
        return total
