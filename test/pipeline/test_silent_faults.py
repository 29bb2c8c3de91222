"""Input that decodes and yet means something else is said to be so: units, frames, and boxes that are shares."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import OPTICAL, camera_info, input_entries, odometry, of_topic, write_bag
from worlds.bags.places import place_entries
from worlds.bags.raw_image import raw_image
from worlds.bags.stereo import disparity_message

from semantic_slam.configuration import from_dict
from semantic_slam.datasets.user_bag.hints import Hints
from semantic_slam.errors import InputError, MessageError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.images import check_unit
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.messages.standard import header_message
from semantic_slam.perception.crops import IN_SHARES, box_fault
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.places import PlaceReader
from semantic_slam.pipeline.assembly.frame_assembler import FrameAssembler
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.offline import run_bag


@pytest.mark.parametrize("scale", [1000.0, 0.001])
def test_depth_in_another_unit_is_said_to_be(scale: float) -> None:
    """With the remedy of what it comes from: of disparities the baseline, which a driver may give in millimetres."""
    depth_m = np.full((48, 64), 2.5, np.float32)
    depth_m[:8] = np.nan
    image = of_topic(input_entries(1), topics.DEPTH_COMPRESSED)[0].message
    disparities = disparity_message(header_message(1, "left"), np.ones((48, 64)))
    for message, remedy in ((image, "send 32FC1 in metres or 16UC1 in millimetres"), (disparities, "f .* and .* T in")):
        check_unit(depth_m, message, "depth")
        check_unit(np.full((48, 64), np.nan, np.float32), message, "depth")
        with pytest.raises(MessageError, match=remedy):
            check_unit(np.asarray(depth_m * scale, np.float32), message, "depth")


def test_a_frame_whose_depth_is_in_millimetres_as_floats_keeps_its_bearings_and_is_counted() -> None:
    entries = input_entries(1)
    assembler = FrameAssembler(from_dict({}), has_depth=True)
    assembler.add_camera_info(of_topic(entries, topics.CAMERA_INFO)[0].message)
    assembler.add_detections(of_topic(entries, topics.DETECTIONS)[0].message)
    assembler.add_image(of_topic(entries, topics.IMAGE_COMPRESSED)[0].message)
    stamp_ns = of_topic(entries, topics.DETECTIONS)[0].stamp_ns
    camera = assembler.camera
    assert camera is not None
    values = np.full((camera.height, camera.width), 2500.0, np.float32)
    assembler.add_depth(raw_image(header_message(stamp_ns, OPTICAL), values, "32FC1"))
    (frame,) = assembler.flush()
    assert frame.depth_m is None
    (reason,) = assembler.dropped
    assert "32FC1 in metres" in reason


def test_boxes_in_shares_of_the_image_are_no_objects() -> None:
    shares = np.array([[0.1, 0.2, 0.4, 0.9], [0.5, 0.5, 0.9, 0.9]])
    assert {box_fault(box, 640, 480) for box in shares} == {IN_SHARES}
    assert box_fault(np.array([10.0, 10.0, 10.5, 40.0]), 640, 480) == ""  # narrow, and yet a box
    reader = PlaceReader(from_dict({}).perception)
    boxes = Detections(
        stamp_ns=1, frame_id=OPTICAL, boxes=shares, labels=("a", "a"), scores=np.ones(2), track_ids=("", "")
    )
    from semantic_slam.messages.camera_info import camera_model

    camera = camera_model(camera_info(1), "camera_info")
    assert not len(reader.measure(boxes, 0, camera, np.array([0.0, 0, 0, -0.5, 0.5, -0.5, 0.5])))
    assert reader.dropped == {IN_SHARES: 2}


def test_odometry_of_another_frame_than_the_body_is_not_used_and_counted() -> None:
    assembler = KeyframeAssembler(from_dict({}))
    for k, frame in enumerate(("camera_link", "base_link", "/base_link", "")):
        assembler.add_odometry(to_message(replace(odometry(10**18 + k, 0.0), child_frame_id=frame)))
    assert assembler.dropped == {"odom: of frame 'camera_link', where perception.base_frame is 'base_link'": 1}
    named = KeyframeAssembler(from_dict({"perception": {"base_frame": "camera_link"}}))
    named.add_odometry(to_message(replace(odometry(10**18, 0.0), child_frame_id="camera_link")))
    assert not named.dropped


def test_a_bag_whose_odometry_is_all_of_another_frame_is_one_line(tmp_path: Path) -> None:
    entries = place_entries("ranges")
    for entry in of_topic(entries, topics.ODOMETRY):
        entry.message.child_frame_id = "camera_link"
    bag = write_bag(tmp_path / "bag", entries)
    with pytest.raises(InputError, match=r"of frame 'camera_link', where perception.base_frame is 'base_link' \(5\)"):
        run_bag(bag, tmp_path / "belief", from_dict({"semantic_model": {"kind": "none"}}))


def hints(changes: dict[str, object]) -> list[str]:
    """What is said of the small bag with some first messages replaced, or given another frame id."""
    entries, tree = input_entries(1), TransformTree()
    tree.add(of_topic(entries, topics.TF_STATIC)[0].message)
    found = Hints("base_link", tree)
    for topic in (topics.ODOMETRY, topics.CAMERA_INFO, topics.DETECTIONS, topics.IMAGE_COMPRESSED):
        message = of_topic(entries, topic)[0].message
        for name, value in changes.items():
            if name == f"{topic} frame":
                message.header.frame_id = value
            elif name.startswith(f"{topic} "):
                setattr(message, name.split()[1], value)
        assert found.wants(topic)
        found.see(topic, message)
        assert not found.wants(topic)
    return found.lines(has_images=True)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"odom child_frame_id": "odom", "odom frame": "base_link"}, "exchange header.frame_id (odom)"),
        (
            {"camera_info frame": "elsewhere", "detections frame": "elsewhere"},
            "no static transforms lead from base_link",
        ),
        ({"detections frame": "lidar"}, "have the detector copy the image's header"),
        ({"camera_info width": 1280}, "images are 160 x 120 and camera_info says 1280 x 120"),
        ({"camera_info k": np.zeros(9)}, "the camera is not calibrated"),
    ],
)
def test_an_import_says_what_a_run_would_not_accept(changes: dict[str, object], words: str) -> None:
    (line,) = hints(changes)
    assert words in line


def test_an_import_says_where_the_camera_is_untold_once_the_body_is_the_odometrys() -> None:
    body, camera = hints({"odom child_frame_id": "base_footprint"})
    assert "set perception.base_frame: base_footprint" in body
    assert "no static transforms lead from base_footprint" in camera


def test_an_import_that_can_run_says_nothing() -> None:
    assert hints({}) == []


def test_a_run_without_a_usable_camera_names_the_fault_and_the_remedy(tmp_path: Path) -> None:
    entries = input_entries(3)
    for entry in of_topic(entries, topics.CAMERA_INFO):
        entry.message.d = np.full(6, 0.01)
    bag = write_bag(tmp_path / "bag", entries)
    fault = r"camera_info: the distortion D is not 4, .* finite numbers, calibrate the camera, or use rectified images"
    with pytest.raises(InputError, match=fault):
        run_bag(bag, tmp_path / "out", from_dict({"semantic_model": {"kind": "none"}}))
