"""Where boxes with depth, and positions that are told, have things in space: points of the body frame."""

from functools import partial

import numpy as np
import pytest

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry import se3, so3
from semantic_slam.perception.boxes.box_sizes import angular_sizes
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.cut_edges import cut_by_border
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.perception.image_sight import ImageSight
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.places import BAD_COVARIANCE, PlaceReader
from semantic_slam.perception.range_bearing import range_and_bearing

SETTINGS = PerceptionConfiguration(
    sigma_range_m=0.05, sigma_range_per_m=0.02, sigma_bearing_rad=0.01, box_centre_share=0.0, depth_to_width=0.0
)
CAMERA = CameraModel(320, 240, 250.0, 250.0, 160.0, 120.0)
BOXES = np.array([[10.0, 20.0, 70.0, 90.0], [150.0, 60.0, 260.0, 200.0]])
MOUNTED = se3.compose(
    np.array([0.1, 0.05, 0.9, 0.0, 0.0, 0.0, 1.0]), np.append(np.zeros(3), so3.exp(np.array([-1.9, 0.1, 0.3])))
)


def seen(**told: object) -> Detections:
    return Detections(
        stamp_ns=1, frame_id="", boxes=BOXES, labels=("cup", "book"), scores=np.ones(2), track_ids=("", ""), **told
    )


def measured(depth_m: float | None, *, in_space: bool = True, **told: object) -> SemanticMeasurements:
    depth = None if depth_m is None else np.full((240, 320), depth_m, dtype=np.float32)
    sensor = partial(range_and_bearing, configuration=SETTINGS)
    classifier = Classifier(None, SETTINGS, seed=0, range_bearing_sensor=sensor, in_space=in_space)
    return classifier.measure(Frame(1, np.zeros((240, 320, 3), np.uint8), depth, CAMERA, seen(**told)), 0, MOUNTED)


def test_boxes_with_depth_are_points_along_their_rays() -> None:
    found = measured(2.0)
    pixels = 0.5 * (BOXES[:, :2] + BOXES[:, 2:])
    optical = 2.0 * np.column_stack([(pixels - [160.0, 120.0]) / 250.0, np.ones(2)])
    np.testing.assert_allclose(found.points, MOUNTED[:3] + so3.rotated(MOUNTED[3:], optical), atol=1e-6)
    np.testing.assert_allclose(np.hypot(*found.points[:, :2].T), found.ranges_m, atol=1e-6)
    np.testing.assert_allclose(found.sensor_orientation, MOUNTED[3:])
    for row, distance in enumerate(np.linalg.norm(optical, axis=1)):
        ray = so3.rotated(MOUNTED[3:], optical[row] / distance)
        along = np.hypot(0.05, 0.02 * distance)
        np.testing.assert_allclose(ray @ found.point_covariances[row] @ ray, along**2, rtol=1e-6)
        sigmas = np.sqrt(np.linalg.eigvalsh(found.point_covariances[row]))
        np.testing.assert_allclose(np.sort(sigmas), np.sort([along, 0.01 * distance, 0.01 * distance]), rtol=1e-5)


def test_without_depth_or_out_of_space_there_are_no_points() -> None:
    assert np.isnan(measured(None).points).all()
    flat = measured(2.0, in_space=False)
    assert np.isnan(flat.points).all() and np.isnan(flat.sensor_orientation).all()


def test_positions_that_are_told_count_before_boxes() -> None:
    positions, covariances = np.array([[1.0, 2.0, 0.5], [np.nan] * 3]), np.tile(0.01 * np.eye(3), (2, 1, 1))
    found = measured(2.0, positions=positions, position_covariances=covariances)
    np.testing.assert_array_equal(found.points[0], positions[0])
    np.testing.assert_array_equal(found.point_covariances[0], covariances[0])
    np.testing.assert_array_equal(found.points[1], measured(2.0).points[1])


def test_positions_straight_above_and_below_are_places_like_any_other() -> None:
    reader = PlaceReader(PerceptionConfiguration(), in_space=True)
    positions = np.array([[0.0, 0.0, 2.0], [1e-9, 0.0, -1.5]])
    told = reader.measure(seen(positions=positions, position_covariances=np.tile(0.01 * np.eye(3), (2, 1, 1))), 0)
    np.testing.assert_array_equal(told.points, positions)
    assert (told.ranges_m > 0.0).all() and not reader.dropped
    spread = np.tile(np.diag([0.01, 0.01, -0.01]), (2, 1, 1))
    assert len(reader.measure(seen(positions=positions, position_covariances=spread), 0)) == 0
    assert reader.dropped == {BAD_COVARIANCE: 2}


@pytest.mark.parametrize("extrinsics", [(), tuple(MOUNTED.tolist())])
def test_where_the_camera_is_mounted_is_told_where_it_is_known(extrinsics: tuple[float, ...]) -> None:
    reader = PlaceReader(PerceptionConfiguration(extrinsics=extrinsics), in_space=True)
    told = reader.measure(seen(positions=np.ones((2, 3))), 0)
    assert np.isfinite(told.sensor_orientation).all() == bool(extrinsics)


def test_how_large_boxes_look_where_the_image_does_not_cut_them() -> None:
    """By the angles between rays to opposite edges; over a camera that is not known they tell nothing."""
    boxes = np.array([[0.0, 20.0, 70.0, 90.0], [150.0, 60.0, 260.0, 200.0], [100.0, 200.0, 140.0, 240.0]])
    sizes = angular_sizes(boxes, cut_by_border(boxes, CAMERA), CAMERA)
    assert np.isnan(sizes).tolist() == [[True, False], [False, False], [False, True]]
    middle, rays = np.array([205.0, 130.0]), []
    for pixel in ([150.0, middle[1]], [260.0, middle[1]]):
        ray = np.append((np.array(pixel) - [160.0, 120.0]) / 250.0, 1.0)
        rays.append(ray / np.linalg.norm(ray))
    assert sizes[1, 0] == pytest.approx(np.arccos(rays[0] @ rays[1]), rel=1e-9)
    found = measured(2.0)
    np.testing.assert_array_equal(found.angular_sizes_rad, angular_sizes(BOXES, cut_by_border(BOXES, CAMERA), CAMERA))
    assert np.isnan(measured(2.0, in_space=False).angular_sizes_rad).all()
    reader = PlaceReader(SETTINGS, in_space=True)
    np.testing.assert_array_equal(reader.measure(seen(), 0, CAMERA, MOUNTED).sensor_orientation, MOUNTED[3:])
    assert np.isnan(reader.measure(seen(bearings_rad=np.zeros(2)), 0).angular_sizes_rad).all()


def sight_of(told: SemanticMeasurements) -> ImageSight | None:
    return ImageSight.told(told.image_edges_rad, told.free_ranges_m)


def test_a_depth_image_tells_how_far_the_camera_sees_but_not_in_boxes() -> None:
    """In the plane there is a scan instead; without depth the edges of the image are told alone."""
    sight = sight_of(measured(2.0))
    assert sight is not None
    np.testing.assert_allclose(np.tan(sight.edges_rad), [[-0.64, 0.64], [-0.48, 0.48]])
    inside, beside = (np.array([50.0, 55.0]) - [160.0, 120.0]) / 250.0, np.array([-0.2, 0.3])
    assert np.isinf(sight.ranges_at(*inside)) and sight.ranges_at(*beside) == pytest.approx(2.13, abs=0.06)
    alone = sight_of(measured(None))
    assert alone is not None and not alone.sees_depth
    assert sight_of(measured(2.0, in_space=False)) is None
