"""What an image covers: edges by the intrinsics, free ranges by its depth."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.perception.camera_sight import sight_of
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.image_sight import NUM_COLUMNS, NUM_ROWS, ImageSight

CAMERA = CameraModel(640, 480, 500.0, 400.0, 300.0, 260.0)


def wall(depth_m: float) -> np.ndarray:
    return np.full((480, 640), depth_m, dtype=np.float32)


def test_edges_are_those_of_the_intrinsics_wherever_the_principal_point_is() -> None:
    (left, right), (top, bottom) = np.tan(sight_of(CAMERA).edges_rad)
    np.testing.assert_allclose([left, right], [-300.0 / 500.0, 340.0 / 500.0])
    np.testing.assert_allclose([top, bottom], [-260.0 / 400.0, 220.0 / 400.0])


def test_lens_distortion_moves_the_edges() -> None:
    bent = sight_of(replace(CAMERA, distortion=(-0.2, 0.0, 0.0, 0.0)))
    assert np.ptp(bent.edges_rad[0]) > np.ptp(sight_of(CAMERA).edges_rad[0]) + 0.01


def test_a_wall_is_as_far_as_its_distance_along_each_ray() -> None:
    sight = sight_of(CAMERA, wall(2.0))
    right, down = np.meshgrid(np.linspace(-0.55, 0.6, 7), np.linspace(-0.6, 0.5, 7))
    true = 2.0 * np.sqrt(1.0 + right**2 + down**2)
    np.testing.assert_allclose(sight.ranges_at(right, down), true, rtol=0.03)
    assert sight.free_ranges_m.shape == (NUM_ROWS, NUM_COLUMNS)
    assert np.isinf(sight.ranges_at(np.array([0.9]), np.array([0.0]))).all(), "beyond the image nothing is known"


def test_what_has_no_depth_and_what_is_detected_hides_nothing() -> None:
    depth = wall(2.0)
    depth[:, :320] = np.nan
    sight = sight_of(CAMERA, depth, np.array([[400.0, 0.0, 640.0, 480.0]]))
    unread, read, detected = sight.ranges_at(np.array([-0.3, 0.1, 0.5]), np.zeros(3))
    assert np.isinf(unread) and np.isinf(detected) and read == pytest.approx(2.0, rel=0.03)


def test_what_a_message_tells_is_the_sight_again() -> None:
    depth = wall(2.0)
    depth[:100, :200] = np.nan
    for sight in (sight_of(CAMERA, depth), sight_of(CAMERA)):
        found = ImageSight.told(sight.edges_rad, sight.free_ranges_m)
        assert found is not None
        np.testing.assert_array_equal(found.edges_rad, sight.edges_rad)
        np.testing.assert_array_equal(found.free_ranges_m, sight.free_ranges_m)


@pytest.mark.parametrize("edges", [[np.nan, np.nan], [0.6, -0.6], [-2.0, 0.5], [-np.inf, 0.5]])
def test_edges_of_no_image_are_no_sight(edges: list[float]) -> None:
    sight = sight_of(CAMERA, wall(2.0))
    assert ImageSight.told(np.array([edges, sight.edges_rad[1]]), sight.free_ranges_m) is None
    assert ImageSight.told(np.array([sight.edges_rad[0], edges]), sight.free_ranges_m) is None


def test_ranges_that_are_none_hide_nothing() -> None:
    sight = sight_of(CAMERA, wall(2.0))
    for forged in (np.nan, -1.0, 0.0, np.inf):
        told = ImageSight.told(sight.edges_rad, np.full_like(sight.free_ranges_m, forged))
        assert told is not None and np.isinf(told.ranges_at(np.zeros(1), np.zeros(1))).all()
