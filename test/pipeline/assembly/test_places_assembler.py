"""Frames that mix positions with boxes alone: in space the boxes are rays of the camera, once it is known."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import T_BASE_CAMERA, input_entries, of_topic

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.spatial_reader import camera_of
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.places import NO_PLACE
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.shipped import CONFIGURATIONS

SPACE = load_configuration(CONFIGURATIONS / "spatial.yaml")
PLANE = replace(SPACE, state_space="planar")
WHOLE = input_entries(1)
CAMERA_INFO = of_topic(WHOLE, topics.CAMERA_INFO)[0].message
ALONE: Detections = from_message(of_topic(WHOLE, topics.DETECTIONS)[0].message)
POINT = np.array([2.0, 0.4, 0.3])


def mixed(told: str = "positions") -> Detections:
    """The first of two boxes has a place."""
    if told == "bearings":
        return replace(ALONE, bearings_rad=np.array([0.2, np.nan]), ranges_m=np.array([2.0, np.nan]))
    return replace(ALONE, positions=np.array([POINT, [np.nan] * 3]))


def assembler(configuration: Configuration = SPACE) -> PlacesAssembler:
    return PlacesAssembler(configuration, lambda _: T_BASE_CAMERA)


def measured(found: Detections, *, has_camera: bool = True) -> tuple[SemanticMeasurements, dict[str, int]]:
    places = assembler()
    if has_camera:
        places.add_camera_info(CAMERA_INFO)
    places.add_detections(to_message(found))
    (told,) = places.flush()
    return told, dict(places.dropped)


@pytest.mark.parametrize("told", ["positions", "bearings"])
@pytest.mark.parametrize("frame_id", ["camera_optical_frame", "base_link"])
def test_in_space_a_box_beside_positions_is_the_ray_that_it_is_alone(told: str, frame_id: str) -> None:
    found, dropped = measured(replace(mixed(told), frame_id=frame_id))
    alone, _ = measured(ALONE)
    assert not dropped and found.detection_ids.tolist() == [0, 1]
    for name in ("bearings_rad", "elevations_rad", "place_covariances", "angular_sizes_rad"):
        np.testing.assert_array_equal(getattr(found, name)[1], getattr(alone, name)[1])
    np.testing.assert_array_equal(found.sensor_orientation, alone.sensor_orientation)
    assert np.isfinite(found.ranges_m).tolist() == [True, False]


def test_a_box_beside_positions_is_dropped_and_counted_only_where_there_is_no_camera() -> None:
    found, dropped = measured(mixed(), has_camera=False)
    assert (dropped, found.detection_ids.tolist()) == ({NO_PLACE: 1}, [0])
    np.testing.assert_array_equal(found.points, [POINT])


def test_boxes_of_another_camera_beside_positions_are_counted() -> None:
    found, dropped = measured(replace(mixed(), frame_id="another"))
    assert found.detection_ids.tolist() == [0] and dropped.pop(NO_PLACE) == 1
    (reason,) = dropped
    assert "frame id 'another' is not the camera's" in reason


def test_positions_stay_where_nobody_has_placed_the_camera() -> None:
    def nowhere(frame_id: str) -> np.ndarray:
        raise InputError(f"no transform to {frame_id}")

    places = PlacesAssembler(SPACE, nowhere)
    places.add_camera_info(CAMERA_INFO)
    places.add_detections(to_message(mixed()))
    (found,) = places.take()
    assert found.detection_ids.tolist() == [0] and any("no transform to" in reason for reason in places.dropped)


@pytest.mark.parametrize(("configuration", "count"), [(SPACE, 2), (PLANE, 1)])
def test_the_camera_may_come_after_the_detections(configuration: Configuration, count: int) -> None:
    """In the plane boxes beside positions do not count, so that nothing waits."""
    before, after = assembler(configuration), assembler(configuration)
    before.add_camera_info(CAMERA_INFO)
    for places in (before, after):
        places.add_detections(to_message(mixed()))
    assert after.num_waiting == 1
    first = after.take()
    assert len(first) == int(configuration is PLANE)
    after.add_camera_info(CAMERA_INFO)
    (late,), (early,) = first or after.take(), before.take()
    np.testing.assert_array_equal(late.place_covariances, early.place_covariances)
    assert len(late) == len(early) == count


def test_positions_alone_wait_for_no_camera() -> None:
    places = assembler()
    places.add_detections(to_message(replace(ALONE, positions=np.tile(POINT, (2, 1)))))
    assert [len(found) for found in places.take()] == [2]


BY_CAMERA = replace(SPACE, open_world=replace(SPACE.open_world, region_by_camera=True))


def test_where_the_image_is_the_region_every_frame_waits_for_the_camera_and_is_the_same_however_late_it_comes() -> None:
    """A frame of positions, one of boxes, and one without detections."""
    alone = replace(ALONE, positions=np.tile(POINT, (2, 1)), boxes=np.full((2, 4), np.nan), frame_id="base_link")
    frames = [alone, replace(ALONE, stamp_ns=ALONE.stamp_ns + 1), ALONE.take(np.zeros(0, dtype=np.intp))]
    frames[2] = replace(frames[2], stamp_ns=ALONE.stamp_ns + 2)
    found = []
    for camera_after in range(4):
        places, told = assembler(BY_CAMERA), []
        for number, frame in enumerate(frames):
            if number == camera_after:
                places.add_camera_info(CAMERA_INFO)
            places.add_detections(to_message(frame))
            told += places.take()
        assert len(told) == (3 if camera_after < 3 else 0)
        if camera_after == 3:
            places.add_camera_info(CAMERA_INFO)
        found.append(told + places.take())
    for others in found[1:]:
        for one, other in zip(found[0], others, strict=True):
            for name, values in vars(one).items():
                np.testing.assert_array_equal(values, getattr(other, name))
    for one in found[0]:
        camera = camera_of(from_message(to_message(one)))
        assert camera.sight is not None and not camera.sight.sees_depth
        np.testing.assert_array_equal(camera.T_body_camera, T_BASE_CAMERA)


def test_without_camera_info_the_region_is_as_typed() -> None:
    places = assembler(BY_CAMERA)
    places.add_detections(to_message(replace(ALONE, positions=np.tile(POINT, (2, 1)))))
    assert places.take() == []
    (told,) = places.flush()
    assert camera_of(told).sight is None and len(told) == 2
