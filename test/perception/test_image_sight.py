"""What an image covers: edges by the intrinsics, free ranges by its depth, there and back through a message."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.image_sight import NUM_COLUMNS, NUM_ROWS, ImageSight, planar_scan

CAMERA = CameraModel(640, 480, 500.0, 400.0, 300.0, 260.0)


def wall(depth_m: float) -> np.ndarray:
    return np.full((480, 640), depth_m, dtype=np.float32)


def test_edges_are_those_of_the_intrinsics_wherever_the_principal_point_is() -> None:
    (left, right), (top, bottom) = np.tan(ImageSight.of(CAMERA).edges_rad)
    np.testing.assert_allclose([left, right], [-300.0 / 500.0, 340.0 / 500.0])
    np.testing.assert_allclose([top, bottom], [-260.0 / 400.0, 220.0 / 400.0])


def test_lens_distortion_moves_the_edges() -> None:
    bent = ImageSight.of(replace(CAMERA, distortion=(-0.2, 0.0, 0.0, 0.0)))
    assert np.ptp(bent.edges_rad[0]) > np.ptp(ImageSight.of(CAMERA).edges_rad[0]) + 0.01


def test_a_wall_is_as_far_as_its_distance_along_each_ray() -> None:
    sight = ImageSight.of(CAMERA, wall(2.0))
    right, down = np.meshgrid(np.linspace(-0.55, 0.6, 7), np.linspace(-0.6, 0.5, 7))
    true = 2.0 * np.sqrt(1.0 + right**2 + down**2)
    np.testing.assert_allclose(sight.ranges_at(right, down), true, rtol=0.03)
    assert sight.free_ranges_m.shape == (NUM_ROWS, NUM_COLUMNS)
    assert np.isinf(sight.ranges_at(np.array([0.9]), np.array([0.0]))).all(), "beyond the image nothing is known"


def test_what_has_no_depth_and_what_is_detected_hides_nothing() -> None:
    depth = wall(2.0)
    depth[:, :320] = np.nan
    sight = ImageSight.of(CAMERA, depth, np.array([[400.0, 0.0, 640.0, 480.0]]))
    unread, read, detected = sight.ranges_at(np.array([-0.3, 0.1, 0.5]), np.zeros(3))
    assert np.isinf(unread) and np.isinf(detected) and read == pytest.approx(2.0, rel=0.03)


def test_a_message_carries_it_and_a_planar_scan_is_none() -> None:
    depth = wall(2.0)
    depth[:100, :200] = np.nan
    for sight in (ImageSight.of(CAMERA, depth), ImageSight.of(CAMERA)):
        found = ImageSight.unpacked(sight.packed())
        assert found is not None and len(planar_scan(sight.packed())) == 0
        np.testing.assert_array_equal(found.edges_rad, sight.edges_rad)
        np.testing.assert_array_equal(found.free_ranges_m, sight.free_ranges_m)
    scan = np.array([[-0.2, 3.0], [0.0, 2.0], [0.2, 2.5], [0.3, 1.0]])
    assert ImageSight.unpacked(scan) is None and len(planar_scan(scan)) == 4


@pytest.mark.parametrize(
    ("row", "value"),
    [
        (0, [16.0, -24.0]),  # another number of cells
        (0, [16.5, -25.0]),
        (0, [1e300, -1e300]),
        (0, [np.nan, -25.0]),
        (1, [0.6, -0.6]),
        (2, [-2.0, 0.5]),
        (2, [-np.inf, 0.5]),
    ],
)
def test_forged_rows_are_no_sight(row: int, value: list[float]) -> None:
    rows = ImageSight.of(CAMERA, wall(2.0)).packed()
    rows[row] = value
    assert ImageSight.unpacked(rows) is None
