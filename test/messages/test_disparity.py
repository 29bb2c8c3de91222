"""Disparities of a stereo pair are depth images, with the errors that stereo has."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.stereo import BASELINE_M, FOCAL_PX, disparity_message

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.errors import MessageError
from semantic_slam.geometry import so3
from semantic_slam.messages.disparity import depth_of_disparity
from semantic_slam.messages.images import decode_depth, size_of
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.typestore import message_class
from semantic_slam.perception.boxes.box_sizes import pixel_rays
from semantic_slam.perception.cut_edges import none_cut
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.points_in_space import points_of_boxes

HEADER = header_message(1, "left_camera_optical_frame")


def test_depth_is_focal_length_times_baseline_over_disparity() -> None:
    """Nothing where a disparity is missing, not positive, below the least one, or outside the valid window."""
    disparities = np.array([[12.0, 6.0, 1.2], [np.nan, 0.0, -1.0], [np.inf, 0.9, 24.0]])
    message = disparity_message(HEADER, disparities, min_disparity=1.0)
    np.testing.assert_allclose(
        decode_depth(message, "disparity"), [[1.0, 2.0, 10.0], [np.nan] * 3, [np.nan, np.nan, 0.5]], rtol=1e-6
    )
    assert size_of(message) == (3, 3)
    window = message_class("sensor_msgs/msg/RegionOfInterest")(
        x_offset=1, y_offset=0, height=1, width=2, do_rectify=False
    )
    seen = decode_depth(disparity_message(HEADER, disparities, valid_window=window), "disparity")
    np.testing.assert_allclose(seen, [[np.nan, 2.0, 10.0], [np.nan] * 3, [np.nan] * 3], rtol=1e-6)


@pytest.mark.parametrize("wrong", [{"f": 0.0}, {"t": -0.1}, {"t": float("nan")}, {"f": float("inf")}])
def test_a_camera_pair_without_focal_length_or_baseline_tells_no_depth(wrong: dict[str, float]) -> None:
    with pytest.raises(MessageError, match="tell no depth; give f and T above 0"):
        decode_depth(disparity_message(HEADER, np.ones((2, 2)), **wrong), "disparity")


@pytest.mark.filterwarnings("error")
def test_a_depth_beyond_all_numbers_is_none() -> None:
    tiny = disparity_message(HEADER, np.array([[1e-45, 1e-38, 12.0]]))
    np.testing.assert_allclose(decode_depth(tiny, "disparity"), [[np.nan, np.nan, 1.0]], rtol=1e-6)
    huge = disparity_message(HEADER, np.array([[1e-3, 12.0]]), f=1e30, t=1e30)
    assert np.isnan(decode_depth(huge, "disparity")).all()
    message = disparity_message(HEADER, np.array([[1e-45]]))
    assert np.isnan(depth_of_disparity(message, np.array([[1e-45]], np.float32), "disparity")).all()


def test_disparities_that_are_no_image_are_refused() -> None:
    message = disparity_message(HEADER, np.ones((4, 4)))
    message.image.height = 1 << 30
    with pytest.raises(MessageError, match="64 bytes are no 4 x 1073741824 image"):
        decode_depth(message, "disparity")
    message = disparity_message(HEADER, np.ones((4, 4)))
    message.image.encoding = "16UC1"
    with pytest.raises(MessageError, match="encoding '16UC1' is not read; send one of 32FC1"):
        decode_depth(message, "disparity")


def test_points_by_stereo_err_by_the_square_of_their_range() -> None:
    """Depth by disparities that err by a quarter of a pixel, against the standard deviation that is stated of it.

    Aside of the optical axis the range is longer than the depth, by the share by which its error is.
    """
    sigma_px, random = 0.25, np.random.default_rng(0)
    settings = PerceptionConfiguration(sigma_range_m=1e-6, sigma_range_per_m2=sigma_px / (FOCAL_PX * BASELINE_M))
    camera = CameraModel(320, 240, FOCAL_PX, FOCAL_PX, 160.0, 120.0)
    ahead = np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
    box = np.array([[150.0, 110.0, 170.0, 130.0]])
    for depth_m in (0.8, 1.6, 3.2):
        disparities = FOCAL_PX * BASELINE_M / depth_m + sigma_px * random.normal(size=(200, 200))
        sampled = decode_depth(disparity_message(HEADER, disparities), "disparity").std()
        found = points_of_boxes(box, none_cut(1), np.array([depth_m]), camera, ahead, settings)
        assert np.sqrt(found.covariances[0, 0, 0]) == pytest.approx(sampled, rel=0.05)
        aside = box + 80.0
        (ray,) = pixel_rays(0.5 * (aside[:, :2] + aside[:, 2:]), camera)
        found = points_of_boxes(aside, none_cut(1), np.array([depth_m / ray[2]]), camera, ahead, settings)
        along = so3.rotated(ahead[3:], ray)
        assert np.sqrt(along @ found.covariances[0] @ along) == pytest.approx(sampled / ray[2], rel=0.05)
    flat = points_of_boxes(box, none_cut(1), np.array([3.2]), camera, ahead, replace(settings, sigma_range_per_m2=0.0))
    assert np.sqrt(flat.covariances[0, 0, 0]) == pytest.approx(1e-6)
