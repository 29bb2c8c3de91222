"""Sensor messages become arrays with the right colours, metres, poses and frames, or name what is wrong."""

import struct

import cv2
import numpy as np
import pytest
from worlds.bags.bag_factory import (
    OPTICAL,
    START,
    T_BASE_CAMERA,
    camera_info,
    compressed,
    input_entries,
    odometry,
    of_topic,
)

from semantic_slam.errors import InputError, MessageError
from semantic_slam.geometry.pose import planar_from_pose_vector, pose_vector_from_planar, transform_points
from semantic_slam.geometry.transform import between, compose, interpolate, inverse, rotation_angle
from semantic_slam.messages import topics
from semantic_slam.messages.camera_info import camera_model
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.images import decode_depth, decode_image
from semantic_slam.messages.sensor import TransformTree, odometry_sample, sensor_pose
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.typestore import message_class

RGB = np.array([[[255, 0, 0], [0, 128, 0], [0, 0, 64]], [[9, 8, 7], [6, 5, 4], [3, 2, 1]]], np.uint8)


def raw(encoding, pixels, padding=0, is_bigendian=0):
    """sensor_msgs/Image whose rows end in ``padding`` bytes."""
    rows = pixels.reshape(pixels.shape[0], -1).view(np.uint8)
    padded = np.hstack([rows, np.full((len(rows), padding), 99, np.uint8)])
    return message_class("sensor_msgs/msg/Image")(
        header=header_message(START, OPTICAL),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=is_bigendian,
        step=padded.shape[1],
        data=padded.ravel(),
    )


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "8UC3", "rgba8", "bgra8"])
def test_colour_encodings(encoding, padding):
    channels = RGB if encoding.startswith("rgb") else RGB[..., ::-1]
    alpha = np.full((2, 3, 1), 7, np.uint8)
    pixels = np.concatenate([channels, alpha], axis=2) if "a8" in encoding else np.ascontiguousarray(channels)
    np.testing.assert_array_equal(decode_image(raw(encoding, pixels, padding), "image"), RGB)


@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_grey_is_given_to_all_channels(encoding):
    grey = RGB[..., 0].copy()
    np.testing.assert_array_equal(decode_image(raw(encoding, grey), "image"), np.repeat(grey[..., None], 3, axis=2))


def test_a_png_keeps_its_colours():
    message = compressed(START, "png", cv2.imencode(".png", RGB[..., ::-1])[1])
    np.testing.assert_array_equal(decode_image(message, "image"), RGB)


def test_an_unknown_encoding_names_the_accepted_ones():
    with pytest.raises(InputError, match=r"^front/image: encoding 'bayer_rggb8' is not read; send one of rgb8, bgr8"):
        decode_image(raw("bayer_rggb8", RGB[..., 0].copy()), "front/image")
    with pytest.raises(InputError, match=r"^depth: encoding 'rgb8' is not read; send one of 16UC1, mono16, 32FC1"):
        decode_depth(raw("rgb8", RGB), "depth")


def test_a_raw_image_of_the_wrong_size():
    message = raw("rgb8", RGB)
    message.height = 3
    with pytest.raises(InputError, match="18 bytes are no 3 x 3 image"):
        decode_image(message, "image")


MILLIMETRES = np.array([[0, 1500], [65535, 250]], np.uint16)
METRES = np.array([[np.nan, 1.5], [65.535, 0.25]], np.float32)


@pytest.mark.parametrize("big", [0, 1])
@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
def test_millimetres(encoding, big):
    pixels = MILLIMETRES.astype(">u2" if big else "<u2")
    np.testing.assert_allclose(decode_depth(raw(encoding, pixels, 2, big), "depth"), METRES)


def test_metres():
    pixels = np.array([[np.nan, 1.5], [np.inf, -1.0]], np.float32)
    depth_m = decode_depth(raw("32FC1", pixels), "depth")
    np.testing.assert_array_equal(depth_m, [[np.nan, 1.5], [np.nan, np.nan]])
    assert depth_m.dtype == np.float32


def test_compressed_depth():
    png = cv2.imencode(".png", MILLIMETRES)[1]
    np.testing.assert_allclose(decode_depth(compressed(START, "16UC1; png compressed", png), "depth"), METRES)
    header = np.frombuffer(struct.pack("<iff", 0, 0.0, 0.0), np.uint8)
    with_header = compressed(START, "16UC1; compressedDepth png", np.concatenate([header, png]))
    np.testing.assert_allclose(decode_depth(with_header, "depth"), METRES)


def test_compressed_inverse_depth():
    scale, offset = 1000.0, -20.0  # value = scale / depth + offset
    values = np.array([[0, round(1000.0 / 2.5 - 20.0)]], np.uint16)
    header = np.frombuffer(struct.pack("<iff", 0, scale, offset), np.uint8)
    data = np.concatenate([header, cv2.imencode(".png", values)[1]])
    depth_m = decode_depth(compressed(START, "32FC1; compressedDepth png", data), "depth")
    np.testing.assert_allclose(depth_m, [[np.nan, 2.5]], rtol=1e-6)


def test_camera_model():
    message = camera_info(START)
    message.d = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    camera = camera_model(message, "camera_info")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (100.0, 100.0, 80.0, 60.0)
    assert camera.distortion == (0.1, 0.2, 0.3, 0.4, 0.5)
    assert camera.frame_id == OPTICAL
    message.distortion_model = "equidistant"
    with pytest.raises(InputError, match=r"distortion model is not known \('equidistant'\)"):
        camera_model(message, "camera_info")


@pytest.mark.parametrize("d", [np.full(6, 0.01), np.array([0.1]), np.full(16, 0.01), np.array([0.1, np.nan, 0, 0, 0])])
def test_a_distortion_that_opencv_does_not_take_is_refused_with_its_remedy(d):
    message = camera_info(START)
    message.d = d
    with pytest.raises(
        MessageError, match=r"camera_info: the distortion D is not 4, 5, .* \(0.*; calibrate the camera"
    ):
        camera_model(message, "camera_info")
    message.d = np.zeros(len(d))  # distorts nothing, by whatever model
    assert camera_model(message, "camera_info").distortion == ()


@pytest.mark.parametrize("spoil", ["position", "orientation"])
def test_odometry_that_is_no_pose_names_its_stamp(spoil):
    message = to_message(odometry(START, 1.0))
    if spoil == "position":
        message.pose.pose.position.y = float("nan")
    else:
        message.pose.pose.orientation.w = 0.0
    with pytest.raises(InputError, match=r"odom: the pose at 1700000000\.000 s"):
        odometry_sample(message, "odom")


def static(parent, child, pose):
    message = of_topic(input_entries(0), topics.TF_STATIC)[0].message
    (item,) = message.transforms
    item.header.frame_id, item.child_frame_id = parent, child
    for values, part in ((pose[:3], item.transform.translation), (pose[3:], item.transform.rotation)):
        for axis, value in zip("xyzw", values, strict=False):
            setattr(part, axis, float(value))
    return message


def planar(x, y, yaw):
    return pose_vector_from_planar(np.array([x, y, yaw]))


def test_a_chain_of_static_transforms():
    tree = TransformTree()
    tree.add(static("base_link", "mast", planar(1, 0, np.pi / 2)))
    tree.add(static("/mast", "camera", planar(2, 0, 0)))
    tree.add(static("base_link", "lidar", planar(0, 5, 0)))
    np.testing.assert_allclose(tree.lookup("base_link", "camera"), planar(1, 2, np.pi / 2), atol=1e-12)
    np.testing.assert_allclose(tree.lookup("lidar", "camera"), planar(1, -3, np.pi / 2), atol=1e-12)
    np.testing.assert_allclose(tree.lookup("camera", "base_link")[:2], [-2, 1], atol=1e-12)


def test_frames_that_nothing_connects():
    tree = TransformTree()
    tree.add(static("base_link", "lidar", planar(0, 5, 0)))
    tree.add(static("a", "b", planar(0, 0, 0)))
    tree.add(static("b", "a", planar(0, 0, 0)))  # a circle must not hang
    for frame in ("camera", "a"):
        with pytest.raises(InputError, match=rf"from base_link to {frame}; publish /tf_static or set perception\.ext"):
            tree.lookup("base_link", frame)


def test_extrinsics_of_the_configuration_come_first():
    np.testing.assert_array_equal(sensor_pose(tuple(T_BASE_CAMERA), "base_link", TransformTree(), "x"), T_BASE_CAMERA)
    with pytest.raises(InputError, match="7 numbers"):
        sensor_pose((1.0, 2.0), "base_link", TransformTree(), "x")
    with pytest.raises(InputError, match=r"perception\.extrinsics: its quaternion is zero"):
        sensor_pose((0.1, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0), "base_link", TransformTree(), "x")


def test_an_optical_frame_looks_forward():
    ahead = transform_points(T_BASE_CAMERA, np.array([[0.0, 0.0, 2.0]]))  # two metres along the optical axis
    np.testing.assert_allclose(ahead, [[2.1, 0.0, 0.3]], atol=1e-12)


def random_pose(seed):
    draws = np.random.default_rng(seed).normal(size=7)
    return np.concatenate([draws[:3], draws[3:] / np.linalg.norm(draws[3:])])


@pytest.mark.parametrize("seed", range(5))
def test_transforms_are_a_group(seed):
    T_a_b, T_b_c = random_pose(seed), random_pose(seed + 100)
    point = np.array([[0.3, -0.2, 0.7]])
    by_steps = transform_points(T_a_b, transform_points(T_b_c, point))
    np.testing.assert_allclose(transform_points(compose(T_a_b, T_b_c), point), by_steps)
    np.testing.assert_allclose(transform_points(compose(T_a_b, inverse(T_a_b)), point), point)
    np.testing.assert_allclose(
        transform_points(between(T_a_b, compose(T_a_b, T_b_c)), point), transform_points(T_b_c, point)
    )


def test_interpolation_takes_the_shorter_arc():
    first, second = planar(0, 0, 3.0), planar(1, 2, -3.0)
    halfway = interpolate(first, second, 0.5)
    np.testing.assert_allclose(halfway[:2], [0.5, 1.0])
    assert abs(planar_from_pose_vector(halfway)[2]) == pytest.approx(np.pi)
    np.testing.assert_allclose(interpolate(first, second, 0.0), first)
    np.testing.assert_allclose(np.abs(interpolate(first, second, 1.0)), np.abs(second))
    assert rotation_angle(between(first, second)) == pytest.approx(2 * np.pi - 6.0)
