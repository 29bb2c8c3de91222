"""Places that a detector tells, without a picture: every expected value follows from geometry."""

import numpy as np
import pytest

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.perception.frame import CameraModel, Detections
from semantic_slam.perception.places import BAD_COVARIANCE, BAD_RANGE, NO_PLACE, PlaceReader, in_body_frame

CAMERA = CameraModel(640, 480, 500.0, 510.0, 320.0, 240.0)
FORWARD = np.array([0.2, 0.1, 0.9, -0.5, 0.5, -0.5, 0.5])
"""T_base_camera of a camera that looks forward: optical z is x, optical x is -y."""


def detections(count: int, **arrays: object) -> Detections:
    usual = {
        "stamp_ns": 5,
        "frame_id": "base_link",
        "boxes": np.full((count, 4), np.nan),
        "labels": tuple(f"thing {row}" for row in range(count)),
        "scores": np.linspace(0.5, 0.9, count),
        "track_ids": tuple(f"t{row}" for row in range(count)),
    }
    return Detections(**(usual | arrays))  # type: ignore[arg-type]


def measure(value: Detections, **settings: object):
    reader = PlaceReader(PerceptionConfiguration(**settings))  # type: ignore[arg-type]
    return reader.measure(value, 7), reader.dropped


def test_range_and_bearing_are_taken_as_they_are() -> None:
    measured, dropped = measure(detections(2, ranges_m=np.array([3.0, 4.0]), bearings_rad=np.array([0.5, -3.0])))
    np.testing.assert_array_equal(measured.ranges_m, [3.0, 4.0])
    np.testing.assert_array_equal(measured.bearings_rad, [0.5, -3.0])
    np.testing.assert_array_equal(measured.sensor_position, np.zeros(3))
    assert np.isnan(measured.geometric_covariances).all()  # the configuration decides
    assert (measured.stamp_ns, measured.sequence, measured.frame_id) == (5, 7, "base_link")
    assert not dropped


def test_what_is_told_besides_the_place_goes_through() -> None:
    scores, vectors = np.array([[0.1, 0.9], [np.nan, 0.3]]), np.arange(6.0).reshape(2, 3)
    value = detections(
        2, bearings_rad=np.zeros(2), class_names=("cup", "bowl"), class_scores=scores, embeddings=vectors
    )
    measured, _ = measure(value)
    assert measured.labels == ("thing 0", "thing 1")
    assert measured.track_ids == ("t0", "t1")
    assert measured.class_names == ("cup", "bowl")
    np.testing.assert_array_equal(measured.scores, [0.5, 0.9])
    np.testing.assert_array_equal(measured.class_scores, scores)
    np.testing.assert_array_equal(measured.embeddings, vectors)


def test_a_distance_along_a_slope_is_shorter_in_the_plane() -> None:
    value = detections(1, ranges_m=np.array([2.0]), bearings_rad=np.zeros(1), elevations_rad=np.array([np.pi / 3]))
    measured, _ = measure(value)
    np.testing.assert_allclose(measured.ranges_m, [1.0])
    np.testing.assert_allclose(measured.elevations_rad, [np.pi / 3])


def test_a_position_is_as_far_as_its_place_in_the_plane() -> None:
    measured, _ = measure(detections(1, positions=np.array([[3.0, 4.0, -5.0]])))
    np.testing.assert_allclose(measured.ranges_m, [5.0])
    np.testing.assert_allclose(measured.bearings_rad, [np.arctan2(4.0, 3.0)])
    np.testing.assert_allclose(measured.elevations_rad, [np.pi / 4])  # it lies below: the line of sight points down


@pytest.mark.parametrize("given", ["place", "position"])
def test_covariances_are_those_of_moved_samples(given: str) -> None:
    rng, count = np.random.default_rng(0), 200_000
    spread = 1e-3 * np.array([[1.0, 0.4, -0.3], [0.0, 1.2, 0.5], [0.0, 0.0, 0.8]])
    covariance, noise = spread @ spread.T, rng.standard_normal((count, 3)) @ spread.T
    mean = np.array([3.0, 0.4, 0.5]) if given == "place" else np.array([2.0, -1.0, 0.7])

    def tell(values: np.ndarray, covariances: np.ndarray) -> Detections:
        if given == "position":
            return detections(len(values), positions=values, position_covariances=covariances)
        r, b, e = values.T
        return detections(len(values), ranges_m=r, bearings_rad=b, elevations_rad=e, place_covariances=covariances)

    stated, _ = measure(tell(mean[None], covariance[None]))
    sampled, _ = measure(tell(mean + noise, np.zeros(0)), max_detections=0)
    rows = np.stack([sampled.ranges_m, sampled.bearings_rad, sampled.elevations_rad])
    np.testing.assert_allclose(stated.place_covariances[0], np.cov(rows), atol=2e-8)
    np.testing.assert_array_equal(stated.geometric_covariances[0], stated.place_covariances[0, :2, :2])


def test_an_unknown_elevation_does_not_hide_the_covariance_of_range_and_bearing() -> None:
    told = np.full((1, 3, 3), np.nan)
    told[0, :2, :2] = [[0.04, 0.001], [0.001, 0.01]]
    value = detections(1, ranges_m=np.ones(1), bearings_rad=np.zeros(1), place_covariances=told)
    measured, _ = measure(value)
    np.testing.assert_array_equal(measured.geometric_covariances, told[:, :2, :2])


def test_detections_without_a_usable_place_are_counted_by_reason() -> None:
    covariances = np.full((6, 3, 3), np.nan)
    covariances[4] = -np.eye(3)
    value = detections(
        6,
        ranges_m=np.array([1.0, np.nan, -1.0, np.nan, 1.0, np.inf]),
        bearings_rad=np.array([0.1, 0.2, 0.3, np.nan, 0.5, 0.6]),
        place_covariances=covariances,
    )
    measured, dropped = measure(value)
    assert measured.detection_ids.tolist() == [0, 1]  # the second is a bearing alone
    assert dropped == {BAD_RANGE: 1, NO_PLACE: 2, BAD_COVARIANCE: 1}
    assert measured.dropped == 4


def test_labels_that_are_not_wanted_are_counted() -> None:
    measured, dropped = measure(detections(2, bearings_rad=np.zeros(2)), labels=("thing 1",))
    assert measured.labels == ("thing 1",)
    assert dropped == {"unknown label 'thing 0'": 1}


def test_a_box_gives_the_bearing_of_its_centre_from_the_camera() -> None:
    boxes = np.array([[40.0, 200.0, 100.0, 280.0], [100.0, 200.0, 100.0, 280.0]])
    reader = PlaceReader(PerceptionConfiguration())
    measured = reader.measure(detections(2, boxes=boxes), 0, CAMERA, FORWARD)
    assert np.isnan(measured.ranges_m).all()
    np.testing.assert_allclose(measured.bearings_rad, [np.arctan2(0.5, 1.0)])
    np.testing.assert_array_equal(measured.sensor_position, FORWARD[:3])
    assert reader.dropped == {NO_PLACE: 1}  # a box without area


def test_positions_of_another_sensor_are_moved_into_the_body_frame() -> None:
    value = detections(1, positions=np.array([[1.0, 2.0, 3.0]]), position_covariances=np.diag([1.0, 4.0, 9.0])[None])
    moved = in_body_frame(value, FORWARD, "base_link")
    np.testing.assert_allclose(moved.positions, [[3.2, -0.9, -1.1]])
    np.testing.assert_allclose(moved.position_covariances[0], np.diag([9.0, 1.0, 4.0]), atol=1e-12)
