"""Filters the measurements of a 3D run.

Usable are those with a 3D position or a direction from the camera; whether it is inside the camera's region is told.
"""

from collections import Counter

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.sightline import LEAST_DISTANCE_M
from semantic_slam.inference.inputs.spatial_reader import camera_of, points_of, rays_of
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.messages import topics
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.points_in_space import SpatialPoints
from semantic_slam.perception.usable_measurements import FARTHEST_M


class PointsInput:
    """Passes usable measurements on; ``dropped`` counts the others, by reason."""

    def __init__(self, configuration: Configuration, dropped: Counter[str]) -> None:
        self._region, self._dropped = SpatialRegion.of(configuration.open_world), dropped

    def usable(self, measurements: SemanticMeasurements) -> SemanticMeasurements:
        """Without detections that have neither a valid 3D position nor a direction."""
        (points, _), (rays, _) = points_of(measurements), rays_of(measurements)
        distances = np.linalg.norm(points, axis=1)
        is_ray = np.isnan(points).any(axis=1) & np.isfinite(rays).all(axis=1)
        told = SpatialPoints(points, measurements.point_covariances)
        by_range_alone = np.isfinite(measurements.geometric_covariances[:, 1, 1]) & ~(
            np.isfinite(measurements.point_covariances).all(axis=(1, 2))
            | np.isfinite(measurements.place_covariances).all(axis=(1, 2))
            | is_ray
        )
        kept = np.ones(len(measurements), dtype=np.bool_)
        for reason, faulty in (
            ("neither place nor direction", ~(told.are_told | is_ray)),
            ("place that is no place", ~(is_ray | ((distances >= LEAST_DISTANCE_M) & (distances <= FARTHEST_M)))),
            ("covariance of a point that is not positive definite", ~told.are_covariances_usable()),
            ("covariance of range and bearing alone, where state_space: spatial needs elevation, too", by_range_alone),
        ):
            count = int((kept & faulty).sum())
            if count:
                self._dropped[f"{topics.MEASUREMENTS}: {reason}"] += count
                kept &= ~faulty
        return measurements if kept.all() else measurements.take(np.flatnonzero(kept))

    def outside(self, measurements: SemanticMeasurements) -> Flags:
        """(D,) which detections lie outside the camera's region; see :func:`are_outside`."""
        return are_outside(measurements, self._region)


def are_outside(measurements: SemanticMeasurements, region: SpatialRegion) -> Flags:
    """(D,) which detections lie outside the region; of a ray without range only the direction is checked.

    Where the camera's image is the region, rays are never outside: those of boxes that its border cuts leave it.
    """
    camera = camera_of(measurements)
    outside = ~region.reaching(camera).holds(seen_from_camera(measurements, region))
    if region.by_camera and camera.sight is not None:
        outside &= np.isfinite(points_of(measurements)[0]).all(axis=1)
    return np.asarray(outside)


def seen_from_camera(measurements: SemanticMeasurements, region: SpatialRegion) -> Array:
    """(D, 3) points of detections in the optical frame; rays without range are put in the middle of the region."""
    (points, _), (rays, _) = points_of(measurements), rays_of(measurements)
    within = measurements.sensor_position + region.shells(1) * rays
    return camera_of(measurements).seen(np.where(np.isnan(points).any(axis=1, keepdims=True), within, points))
