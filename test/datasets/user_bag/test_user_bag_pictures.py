"""Colour and depth images of a user's own bag, in any encoding and transport."""

import struct

import cv2
import numpy as np
import pytest
from worlds.bags.bag_factory import camera_info
from worlds.bags.imported import import_bag, merge_bags, read_bag, run_import
from worlds.bags.stereo import BASELINE_M, FOCAL_PX, disparity_message
from worlds.bags.user_bag_factory import HEIGHT, SECOND, WIDTH, UserBag, picture, write_drive

from semantic_slam.bag.reader import BagReader
from semantic_slam.datasets.user_bag.hints import Hints
from semantic_slam.datasets.user_bag.image_formats import to_millimetres
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.messages.standard import header_message


def decoded(message):
    return cv2.imdecode(np.asarray(message.data), cv2.IMREAD_UNCHANGED)


def test_raw_colour_keeps_its_colours(tmp_path, monkeypatch):
    run_import(monkeypatch, "bag", write_drive(tmp_path / "source"), "--out", tmp_path / "bag")
    image = decoded(read_bag(tmp_path / "bag")["/image/compressed"][0])
    rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    assert np.abs(rgb.astype(int) - picture(0)).mean() < 4.0  # JPEG; swapped channels give more than 50


@pytest.mark.parametrize("kind", ["16UC1", "32FC1", "compressedDepth"])
def test_depth_becomes_millimetres(tmp_path, monkeypatch, kind):
    run_import(monkeypatch, "bag", write_drive(tmp_path / "source", depth=kind), "--out", tmp_path / "bag")
    depth = decoded(read_bag(tmp_path / "bag")["/depth/compressed"][1])
    assert depth.dtype == np.uint16
    assert depth[0, 0] == 0  # was NaN
    np.testing.assert_allclose(depth[1:], 2900, atol=1)


def test_disparities_become_depth_where_there_are_no_depth_images(tmp_path, monkeypatch, capsys):
    with UserBag(tmp_path / "stereo") as bag:
        for k in range(3):
            stamp = (k + 1) * SECOND
            disparities = np.full((HEIGHT, WIDTH), FOCAL_PX * BASELINE_M / 2.0)
            disparities[0, 0] = -1.0
            bag.write("/stereo/disparity", disparity_message(header_message(stamp, "left"), disparities), stamp)
    for name, depth in (("alone", ""), ("beside", "16UC1")):
        merge_bags(tmp_path / name, write_drive(tmp_path / f"{name}_source", depth=depth), tmp_path / "stereo")
        run_import(monkeypatch, "bag", tmp_path / name, "--out", tmp_path / f"{name}_bag")
        hint = "by a stereo pair (100 px, 0.12 m): set perception.sigma_range_per_m2: 0.021" in capsys.readouterr().out
        assert hint == (name == "alone")
    by_stereo, by_depth = (read_bag(tmp_path / f"{name}_bag")["/depth/compressed"] for name in ("alone", "beside"))
    found = decoded(by_stereo[0])
    assert found[0, 0] == 0 and (found[1:] == 2000).all()
    assert decoded(by_depth[1])[1, 1] == 2900


def test_disparities_beside_a_distorting_lens_are_worth_a_hint():
    hints, info = Hints("base_link", TransformTree()), camera_info(1)
    hints.see(topics.DISPARITY, disparity_message(info.header, np.ones((2, 2))))
    hints.see(topics.CAMERA_INFO, info)
    assert not any("rectified" in line for line in hints.lines(has_images=True))
    info.d[0] = 0.01
    assert "set perception.rectified: true" in hints.lines(has_images=True)[-1]


def test_inverse_depth_of_compressed_depth_transport(tmp_path, monkeypatch):
    # 32FC1 travels as q = scale / depth + offset: 2 m with scale 1000 and offset 10 is q = 510; q = 0 is invalid.
    source = write_drive(tmp_path / "source", frames=1, depth="")
    quantised = np.full((HEIGHT, WIDTH), 510, dtype=np.uint16)
    quantised[0, 0] = 0
    with UserBag(tmp_path / "depth") as bag:
        header = struct.pack("<iff", 0, 1000.0, 10.0)
        message = bag.compressed(SECOND, quantised, ".png", "32FC1; compressedDepth png", header)
        bag.write("/depth/compressedDepth", message, SECOND)
    merge_bags(tmp_path / "both", source, tmp_path / "depth")
    run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag")
    depth = decoded(read_bag(tmp_path / "bag")["/depth/compressed"][0])
    assert depth[0, 0] == 0
    assert (depth[1:] == 2000).all()


def test_depth_beyond_what_16_bits_hold_is_invalid():
    metres = np.array([[0.0, -1.0, np.nan, np.inf, 65.535, 65.536, 1.2344]], dtype=np.float32)
    np.testing.assert_array_equal(to_millimetres(metres), [[0, 0, 0, 0, 65535, 0, 1234]])


def test_without_depth_none_is_written(tmp_path, monkeypatch, capsys):
    run_import(monkeypatch, "bag", write_drive(tmp_path / "source", depth=""), "--out", tmp_path / "bag")
    assert "/depth/compressed" not in read_bag(tmp_path / "bag")
    assert "bearing only" in capsys.readouterr().out


def test_depth_can_be_left_out_and_is_then_counted(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=3)
    run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag", "--depth", "none")
    assert "/depth/compressed" not in read_bag(tmp_path / "bag")
    assert "not needed: /camera/aligned_depth/image_raw 3" in capsys.readouterr().out


def test_images_that_do_not_decode_are_counted(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=2)
    with UserBag(tmp_path / "broken") as bag:
        message = bag.image(3 * SECOND, picture(0), "rgb8")
        message.data = message.data[:100]
        bag.write("/camera/color/image_raw", message, 3 * SECOND)
    merge_bags(tmp_path / "both", source, tmp_path / "broken")
    assert len(import_bag(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag")["/image/compressed"]) == 2
    assert "/camera/color/image_raw: 100 bytes are no 160 x 120 image of rgb8" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["/camera/aligned_depth/image_raw", "/nope"])
def test_depth_that_is_named_and_would_not_be_used_is_refused(tmp_path, monkeypatch, name):
    source = write_drive(tmp_path / "source", frames=1)
    with pytest.raises(InputError, match=rf"--depth {name} would not be used, as it needs colour images"):
        run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag", "--image", "none", "--depth", name)
    run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag", "--image", "none", "--depth", "none")
    assert "/depth/compressed" not in read_bag(tmp_path / "bag")


@pytest.mark.parametrize("kind", ["16UC1", "32FC1", "compressedDepth"])
def test_depth_that_is_not_used_for_want_of_colour_is_said_to_be(tmp_path, monkeypatch, capsys, kind):
    source = write_drive(tmp_path / "source", frames=3, depth=kind)
    with BagReader(source) as reader, UserBag(tmp_path / "colourless") as bag:
        for message in reader.messages(reader.topics.keys() - {"/camera/color/image_raw"}):
            bag.write(message.topic, reader.decode(message.cdr, message.type_name), message.stamp_ns)
    run_import(monkeypatch, "bag", tmp_path / "colourless", "--out", tmp_path / "bag")
    told = capsys.readouterr().out
    assert "depth not used, as it needs colour images, which --image names" in told and "not needed" not in told
    run_import(monkeypatch, "bag", tmp_path / "colourless", "--out", tmp_path / "without", "--depth", "none")
    told = capsys.readouterr().out
    assert "colour" not in told and "not needed: /camera/aligned_depth" in told


def test_depth_beside_positions_is_needed_by_nobody(tmp_path, monkeypatch, capsys):
    with UserBag(tmp_path / "source", "vision_3d") as bag:
        bag.write("/odom", bag.odometry(SECOND, 0.0), SECOND)
        bag.write("/lidar/boxes", bag.vision_3d(SECOND, [("car", (1.0, 2.0, 3.0))], 0.1, "base_link"), SECOND)
        millimetres = np.full((HEIGHT, WIDTH), 2000, dtype=np.uint16)
        bag.write("/camera/depth", bag.image(SECOND, millimetres, "16UC1"), SECOND)
    run_import(monkeypatch, "bag", tmp_path / "source", "--out", tmp_path / "bag")
    assert "not needed: /camera/depth 1" in capsys.readouterr().out
