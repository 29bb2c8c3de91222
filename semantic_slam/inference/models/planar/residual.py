"""Residual of a measured range and bearing."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.planar.detection import PlanarDetections
from semantic_slam.inference.models.planar.frames import object_in_body
from semantic_slam.inference.models.planar.polar import polar, polar_jacobian
from semantic_slam.inference.models.repeated_rows import per_detection


@dataclass(frozen=True)
class MeasuredRows:
    """Robots and objects (B / S, S, 3) against S repeated detections."""

    detections: PlanarDetections
    x: Array
    o: Array

    @classmethod
    def of(cls, detections: PlanarDetections, x: Array, o: Array) -> "MeasuredRows":
        count = len(detections.range_m)
        return cls(detections, per_detection(x, count), per_detection(o, count))

    def polar_residual(self) -> tuple[Array, Array, Array, Array]:
        """(..., 2) object in the body frame and from the detection's origin, its (...,) distance, (..., 2) residual."""
        detections, body = self.detections, object_in_body(self.x, self.o)
        d = body - detections.origin
        distance, bearing = polar(d)
        by_range, turn = distance - detections.range_m, wrap_angle(bearing - detections.bearing_rad)
        whitened = np.empty(d.shape)
        whitened[..., 0] = detections.whiten[..., 0, 0] * by_range
        whitened[..., 1] = detections.whiten[..., 1, 0] * by_range + detections.whiten[..., 1, 1] * turn
        return body, d, distance, whitened

    def by_polar(self, d: Array, distance: Array) -> Array:
        """(..., 2, 2) derivative of the residual by the point ``d``."""
        radial, turn = polar_jacobian(d, distance)
        whiten = self.detections.whiten
        derivative = np.empty((*d.shape, 2))
        derivative[..., 0, :] = whiten[..., 0, :1] * radial
        derivative[..., 1, :] = whiten[..., 1, :1] * radial + whiten[..., 1, 1:] * turn
        return derivative
