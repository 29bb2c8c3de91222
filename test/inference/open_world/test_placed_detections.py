"""Detections as points: without what the sensor always gets wrong they are where things are."""

import numpy as np
import pytest

from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.open_world.moving.placed_detections import PlacedDetections


@pytest.mark.parametrize(("offset_m", "yaw_rad"), [(0.1, 0.0), (0.0, 0.08), (-0.05, -0.04)])
def test_points_without_sensor_errors_are_the_true_ones_to_first_order(offset_m: float, yaw_rad: float) -> None:
    true = np.array([[3.0, 1.5], [5.0, -2.0]])
    detections = [
        PlanarDetection(
            range_m=float(np.hypot(*point)) + offset_m,
            bearing_rad=float(np.arctan2(point[1], point[0])) + yaw_rad,
            covariance=np.diag([0.05, 0.02]) ** 2,
            sensor=np.zeros(2),
            feature=np.zeros(0),
            feature_covariance=np.zeros((0, 0)),
        )
        for point in true
    ]
    sigmas = np.array([0.2, 0.1])
    placed = PlacedDetections.of(detections, sigmas)
    found = placed.without_sensor_errors(np.arange(2), np.tile(np.array([offset_m, yaw_rad]) / sigmas, (2, 1)))
    second_order = 0.5 * yaw_rad**2 * 5.5 + abs(yaw_rad * offset_m)
    np.testing.assert_allclose(found, true, atol=1.1 * second_order + 1e-9)
    np.testing.assert_array_equal(placed.without_sensor_errors(np.arange(2), np.zeros((2, 0))), placed.points)
