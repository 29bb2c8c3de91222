"""Common part of observation models of points: landmarks with a position, and nothing viewpoint-dependent."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.states.spaces import Spaces


class PointGeometry:
    """Geometry alone: a point has no orientation, so views say nothing of its class."""

    spaces: Spaces

    @property
    def num_classes(self) -> int:
        """0: points have no classes."""
        return 0

    def distance(self, point: Array) -> Array:
        """(B,) metres of points (B, p) in the body frame."""
        raise NotImplementedError

    def semantics(self, detections: object, x: Array, o: Array, classes: Classes) -> Linearisation:
        """Raises NotImplementedError: points have no classes."""
        raise NotImplementedError("points have no classes; set semantic_model.kind: none")

    def best_heading(
        self, detections: object, x: Array, o: Array, classes: Classes, sigma: Array
    ) -> tuple[Array, Array]:
        """Raises NotImplementedError: points have no heading."""
        raise NotImplementedError("points have no heading; set semantic_model.kind: none")

    def bearing_sigma(self, x: Array, o: Array, covariance: Array, charts: Array) -> Array:
        """Standard deviation of the direction, from the covariance of the point in the body frame."""
        relative = self.spaces.relative_position(x, o)
        jacobian = np.concatenate([relative.by_robot, relative.by_landmark], axis=-1) @ charts
        spread = ((jacobian @ covariance) * jacobian).sum(axis=(1, 2))
        return np.asarray(np.sqrt(np.maximum(spread, 0.0)) / self.distance(relative.point))

    def view_change(self, before: Array, now: Array) -> Array:
        """Change of the view's direction [rad], from points in the robot's frame before and now."""
        return np.asarray(np.hypot.reduce(now - before, axis=1) / self.distance(before))
