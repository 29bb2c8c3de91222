"""How far a depth image sees, and what that hides from the count of misses."""

import numpy as np
import pytest

from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.free_range_scan import NUM_STRIPS, farthest_free_ranges

CAMERA = CameraModel(640, 480, 500.0, 500.0, 320.0, 240.0)
FORWARD = np.array([0.2, 0.0, 0.9, -0.5, 0.5, -0.5, 0.5])
"""T_base_camera of a camera 20 cm ahead of the body's origin that looks forward."""


def wall(depth_m: float) -> np.ndarray:
    return np.full((480, 640), depth_m, dtype=np.float32)


def test_a_wall_is_as_far_as_it_is() -> None:
    """A plane at x = 3.2 m: at bearing b it is 3.2 / cos b away; bearings go from left to right of the image."""
    free_range_scan = farthest_free_ranges(wall(3.0), CAMERA, FORWARD)
    assert free_range_scan.shape == (NUM_STRIPS, 2)
    np.testing.assert_allclose(free_range_scan[:, 1] * np.cos(free_range_scan[:, 0]), 3.2, rtol=1e-6)
    assert (np.diff(free_range_scan[:, 0]) < 0.0).all()
    assert free_range_scan[0, 0] == pytest.approx(np.arctan2(0.64 * 3.0, 3.2), abs=0.03)


def test_what_is_low_hides_nothing() -> None:
    depth = wall(5.0)
    depth[300:] = 1.0
    np.testing.assert_allclose(
        farthest_free_ranges(depth, CAMERA, FORWARD), farthest_free_ranges(wall(5.0), CAMERA, FORWARD)
    )


def test_strips_without_depth_tell_nothing() -> None:
    depth = wall(3.0)
    depth[:, :320] = np.nan
    free_range_scan = farthest_free_ranges(depth, CAMERA, FORWARD)
    assert len(free_range_scan) == NUM_STRIPS // 2
    assert (free_range_scan[:, 0] < 0.0).all()
    assert farthest_free_ranges(np.zeros((480, 640), dtype=np.float32), CAMERA, FORWARD).shape == (0, 2)


def test_objects_behind_the_farthest_surface_are_hidden() -> None:
    """A wall 3.2 m ahead: what is at 2 m and at 3.4 m, within two radii of it, may be seen, what is at 4 m may not."""
    region = SensorRegion(min_range_m=0.5, max_range_m=6.0, field_of_view_rad=1.4, occluder_radius_m=0.2)
    free_range_scan = farthest_free_ranges(wall(3.0), CAMERA, FORWARD)
    positions = np.array([[2.0, 0.3], [3.4, 0.0], [4.0, 0.3], [0.0, 4.0]])
    nothing = np.zeros(0)
    np.testing.assert_array_equal(
        region.not_occluded(positions, nothing, nothing, free_range_scan), [1.0, 1.0, 0.0, 1.0]
    )
    np.testing.assert_array_equal(region.not_occluded(positions, nothing, nothing), 1.0)
    generous = SensorRegion(min_range_m=0.5, max_range_m=6.0, field_of_view_rad=1.4, occluder_radius_m=0.0)
    np.testing.assert_array_equal(generous.not_occluded(positions, nothing, nothing, free_range_scan), 1.0)
