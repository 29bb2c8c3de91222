"""Directions of boxes are as uncertain as the boxes are large, and more where the image's border cuts them."""

from functools import partial

import numpy as np
import pytest

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.inputs.spatial_reader import rays_of
from semantic_slam.perception.boxes.box_rays import as_places, ray_covariances
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.crops import IN_SHARES
from semantic_slam.perception.cut_edges import cut_by_border, none_cut
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.perception.places import PlaceReader
from semantic_slam.perception.range_bearing import range_and_bearing

CAMERA = CameraModel(320, 240, 250.0, 250.0, 160.0, 120.0)
SETTINGS = PerceptionConfiguration(sigma_bearing_rad=0.01, box_centre_share=0.1)
AHEAD = np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
TILTED = np.append([0.1, -0.2, 0.5], so3.product(AHEAD[3:], so3.exp(np.array([0.5, 0.2, 0.0]))))
MIDDLE, CUT = np.array([130.0, 100.0, 190.0, 140.0]), np.array([0.0, 100.0, 60.0, 140.0])


def detections(boxes, **places):
    count = len(boxes)
    names = {"labels": ("cup",) * count, "track_ids": ("",) * count}
    return Detections(stamp_ns=1, frame_id="", boxes=boxes, scores=np.ones(count), **names, **places)


def told(boxes, mount=AHEAD, settings=SETTINGS):
    return PlaceReader(settings, in_space=True).measure(detections(np.atleast_2d(boxes)), 0, CAMERA, mount)


def test_a_centre_errs_by_a_share_of_the_larger_side_in_all_directions():
    found = told(MIDDLE)
    wanted = 0.01**2 + (0.1 * 2.0 * np.arctan(30.0 / 250.0)) ** 2
    np.testing.assert_allclose(found.place_covariances[0, 1:, 1:], wanted * np.eye(2), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose([found.bearings_rad[0], found.elevations_rad[0]], 0.0, atol=1e-12)
    assert np.isnan(found.place_covariances[0, 0]).all()
    assert np.isnan(found.ranges_m).all()


def test_what_the_border_cuts_goes_on_beyond_it_by_a_share_of_what_shows_and_tells_no_size():
    found = told(CUT)
    shown = np.arctan(160.0 / 250.0) - np.arctan(100.0 / 250.0)
    across = np.sqrt(found.place_covariances[0, 1, 1])
    assert across == pytest.approx(np.hypot(0.01, shown), rel=0.02)
    assert found.bearings_rad[0] == pytest.approx(np.arctan((160.0 - 30.0 + 0.3 * 60.0) / 250.0))
    assert np.isnan(found.angular_sizes_rad[0]).tolist() == [True, False]


def test_what_both_borders_cut_is_in_the_middle_of_what_shows():
    found = told(np.array([0.0, 100.0, 320.0, 140.0]))
    assert found.bearings_rad[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("mount", [AHEAD, TILTED])
def test_a_box_is_the_same_ray_with_a_picture_and_without(mount):
    """Also where the border cuts it; with a picture but no depth."""
    boxes = np.array([MIDDLE, CUT, [250.0, 180.0, 320.0, 240.0], [0.0, 100.0, 320.0, 140.0]])
    sensor = partial(range_and_bearing, configuration=SETTINGS)
    classifier = Classifier(None, SETTINGS, seed=0, range_bearing_sensor=sensor, in_space=True)
    frame = Frame(1, np.zeros((240, 320, 3), np.uint8), None, CAMERA, detections(boxes))
    pictured, alone = classifier.measure(frame, 0, mount), told(boxes, mount)
    np.testing.assert_array_equal(rays_of(pictured)[0], rays_of(alone)[0])
    for name in ("place_covariances", "angular_sizes_rad", "sensor_position", "sensor_orientation", "points"):
        np.testing.assert_array_equal(getattr(pictured, name), getattr(alone, name))
    rays, _ = ray_covariances(boxes, cut_by_border(boxes, CAMERA), CAMERA, mount, SETTINGS)
    np.testing.assert_allclose(rays_of(alone)[0], rays, atol=1e-12)


def test_boxes_beside_positions_are_the_rays_that_they_are_alone():
    boxes = np.array([MIDDLE, CUT, MIDDLE, [np.nan] * 4])
    places = {"positions": np.full((4, 3), np.nan), "bearings_rad": np.array([np.nan, np.nan, np.nan, 0.3])}
    places["positions"][2] = [2.0, 0.5, 0.1]
    reader = PlaceReader(SETTINGS, in_space=True)
    found, alone = reader.measure(detections(boxes, **places), 0, CAMERA, AHEAD), told(boxes[:2])
    assert found.detection_ids.tolist() == [0, 1, 2, 3] and not reader.dropped
    for name in ("bearings_rad", "elevations_rad", "place_covariances", "angular_sizes_rad"):
        np.testing.assert_array_equal(getattr(found, name)[:2], getattr(alone, name))
    assert np.isnan(found.ranges_m).tolist() == [True, True, False, True]
    np.testing.assert_array_equal(found.points[2], [2.0, 0.5, 0.1])
    assert found.bearings_rad[3] == 0.3


def test_a_box_in_shares_of_the_image_is_none_wherever_it_ends():
    reader = PlaceReader(SETTINGS, in_space=True)
    assert len(reader.measure(detections(np.array([[0.0, 0.0, 0.9, 0.9]])), 0, CAMERA, AHEAD)) == 0
    assert reader.dropped == {IN_SHARES: 1}


def test_rays_and_their_covariances_turn_with_the_mount():
    turn = so3.exp(np.array([0.3, -0.2, 0.9]))
    mount = np.append([0.1, 0.0, 0.2], so3.product(turn, AHEAD[3:]))
    boxes = np.array([MIDDLE, [200.0, 30.0, 280.0, 60.0]])
    rays, spread = ray_covariances(boxes, none_cut(2), CAMERA, AHEAD, SETTINGS)
    turned, spread_turned = ray_covariances(boxes, none_cut(2), CAMERA, mount, SETTINGS)
    R = so3.matrix(turn)
    np.testing.assert_allclose(turned, rays @ R.T, atol=1e-12)
    np.testing.assert_allclose(spread_turned, R @ spread @ R.T, atol=1e-12)
    np.testing.assert_allclose((spread @ rays[:, :, None])[..., 0], 0.0, atol=1e-12)


def test_bearing_and_elevation_err_as_the_rays_do():
    """By samples: rays with errors, looked at as bearing and elevation."""
    mount = se3.compose(np.append(np.zeros(3), so3.exp(np.array([0.0, 0.6, 0.2]))), AHEAD)
    rays, spread = ray_covariances(np.array([[250.0, 30.0, 310.0, 60.0]]), none_cut(1), CAMERA, mount, SETTINGS)
    random = np.random.default_rng(0).multivariate_normal(rays[0], spread[0], 40000, method="svd")
    x, y, z = (random / np.linalg.norm(random, axis=1)[:, None]).T
    sampled = np.cov(np.arctan2(y, x), np.arcsin(-z))
    np.testing.assert_allclose(as_places(rays, spread)[0, 1:, 1:], sampled, rtol=0.06, atol=3e-6)


def test_what_a_detector_tells_itself_stays():
    own = np.full((1, 3, 3), np.nan)
    own[0, 1:, 1:] = np.diag([0.02, 0.03]) ** 2
    places = {"bearings_rad": np.array([0.1]), "elevations_rad": np.array([0.2]), "place_covariances": own}
    seen = detections(MIDDLE[None], **places)
    found = PlaceReader(SETTINGS, in_space=True).measure(seen, 0, CAMERA, AHEAD)
    np.testing.assert_array_equal(found.place_covariances, own)
