"""Range and bearing from boxes, depth and extrinsics: every expected value follows from geometry."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.range_bearing import depth_in_box, range_and_bearing, viewing_ray

CAMERA = CameraModel(640, 480, 500.0, 510.0, 320.0, 240.0)
FORWARD = np.array([0.2, 0.0, 0.9, -0.5, 0.5, -0.5, 0.5])
"""T_base_camera of a camera 20 cm ahead of the body's origin that looks forward: optical z is x, optical x is -y."""
SETTINGS = PerceptionConfiguration(sigma_range_m=0.2, sigma_bearing_rad=0.03, depth_to_width=0.0)


def box_around(u: float, v: float, half: float = 30.0) -> np.ndarray:
    return np.array([u - half, v - half, u + half, v + half])


def plane(depth_m: float) -> np.ndarray:
    return np.full((480, 640), depth_m, dtype=np.float32)


def test_an_object_straight_ahead() -> None:
    measured = range_and_bearing(box_around(320, 240), plane(3.0), CAMERA, FORWARD, SETTINGS)
    assert measured.range_m == pytest.approx(3.2)  # 3 m from the camera, which is 0.2 m ahead
    assert measured.bearing_rad == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(measured.covariance, np.diag([0.04, 0.0009]))


def test_an_object_on_the_left_has_a_positive_bearing() -> None:
    """At u = 70 the ray is (-0.5, 0, 1); 2 m deep the object is at (2.2, 1.0) in the body frame."""
    measured = range_and_bearing(box_around(70, 240), plane(2.0), CAMERA, FORWARD, SETTINGS)
    assert measured.range_m == pytest.approx(np.hypot(2.2, 1.0))
    assert measured.bearing_rad == pytest.approx(np.arctan2(1.0, 2.2))


def test_height_does_not_count() -> None:
    """Range lies in the x-y plane: an object below the camera at the same depth is as far away."""
    high = range_and_bearing(box_around(320, 240), plane(3.0), CAMERA, FORWARD, SETTINGS)
    low = range_and_bearing(box_around(320, 400), plane(3.0), CAMERA, FORWARD, SETTINGS)
    assert low.range_m == pytest.approx(high.range_m)


def test_the_objects_own_depth_lies_along_the_ray() -> None:
    """(2.0, 1.0) from the camera, then half of its apparent width further in that direction."""
    settings = replace(SETTINGS, depth_to_width=0.5)
    box = box_around(70, 240)
    width_m = (box[2] - box[0]) / CAMERA.fx * 2.0
    measured = range_and_bearing(box, plane(2.0), CAMERA, FORWARD, settings)
    x, y = np.array([2.0, 1.0]) * (1.0 + 0.5 * width_m / np.hypot(2.0, 1.0)) + (0.2, 0.0)
    assert measured.range_m == pytest.approx(np.hypot(x, y))
    assert measured.bearing_rad == pytest.approx(np.arctan2(y, x))


def test_a_camera_that_looks_left() -> None:
    """Body yaw + 90 deg of the optical frame: straight ahead for the camera is +y for the body."""
    left = np.array([0.0, 0.0, 0.9, -np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    measured = range_and_bearing(box_around(320, 240), plane(4.0), CAMERA, left, SETTINGS)
    assert measured.range_m == pytest.approx(4.0)
    assert measured.bearing_rad == pytest.approx(np.pi / 2.0)


@pytest.mark.parametrize("depth", [None, plane(np.nan), plane(0.0), plane(50.0)])
def test_without_usable_depth_only_the_bearing_from_the_camera(depth: np.ndarray | None) -> None:
    measured = range_and_bearing(box_around(70, 240), depth, CAMERA, FORWARD, SETTINGS)
    assert np.isnan(measured.range_m) and np.isnan(measured.covariance[0, 0])
    assert measured.bearing_rad == pytest.approx(np.arctan2(0.5, 1.0))  # from the camera, not from the body's origin
    assert measured.covariance[1, 1] == pytest.approx(0.0009)
    assert measured.covariance[0, 1] == 0.0


def test_lens_distortion_is_removed() -> None:
    """Distort a known ray with OpenCV's forward model; the viewing ray must be the known one."""
    distortion = (0.08, -0.02, 0.001, -0.0005)
    camera = replace(CAMERA, distortion=distortion)
    matrix = np.array([[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]])
    truth = np.array([0.4, -0.2, 1.0])
    pixel, _ = cv2.projectPoints(truth[None], np.zeros(3), np.zeros(3), matrix, np.array(distortion))
    ray = viewing_ray(box_around(*pixel.reshape(2)), camera)
    np.testing.assert_allclose(ray, truth / np.linalg.norm(truth), atol=1e-6)


def test_depth_ignores_holes_background_and_the_boxs_rim() -> None:
    depth = plane(5.0)  # the wall behind
    depth[200:280, 280:360] = 2.0  # the object
    depth[230:240, 300:340] = np.nan
    depth[240:244, 300:340] = 0.0
    assert depth_in_box(depth, np.array([270.0, 190.0, 370.0, 290.0]), 10.0) == pytest.approx(2.0)


@pytest.mark.parametrize(("share", "behind"), [(0.0, 0.0), (0.3, 1.5), (0.5, 1.5), (0.5, 8.0), (0.6, 4.0)])
def test_white_noise_of_stereo_pulls_no_object_nearer_also_before_a_wall(share: float, behind: float) -> None:
    """Of a surface at 4 m, of which a share of the box shows a wall behind; the 30th percentile alone is off by up to
    0.7 standard deviations, nearer without a wall and farther with one."""
    random, focal_by_baseline, sigma_px, own = np.random.default_rng(0), 24.0, 0.25, 4.0
    per_m2 = sigma_px / focal_by_baseline
    sigma, errors = per_m2 * own**2, []
    for _ in range(20):
        surface = np.where(random.random((480, 640)) < share, own + behind, own)
        disparities = focal_by_baseline / surface + sigma_px * random.normal(size=surface.shape)
        depth = (focal_by_baseline / disparities).astype(np.float32)
        settings = replace(SETTINGS, sigma_range_per_m2=per_m2, max_depth_m=30.0)
        errors.append(range_and_bearing(box_around(320, 240), depth, CAMERA, FORWARD, settings).range_m - 0.2 - own)
    assert abs(np.mean(errors)) < 0.12 * sigma and np.std(errors) < 0.2 * sigma


def test_depth_of_other_sensors_is_the_percentile() -> None:
    depth = (3.0 + 0.1 * np.random.default_rng(1).normal(size=(480, 640))).astype(np.float32)
    centre = depth[222:258, 302:338]  # the middle 60 % of the box
    assert depth_in_box(depth, box_around(320, 240), 10.0) == float(np.percentile(centre, 30.0))


def test_a_box_over_the_images_border_reads_what_is_inside() -> None:
    assert depth_in_box(plane(2.5), np.array([-40.0, 200.0, 60.0, 300.0]), 10.0) == pytest.approx(2.5)
    assert np.isnan(depth_in_box(plane(2.5), np.array([-40.0, 200.0, -2.0, 300.0]), 10.0))
