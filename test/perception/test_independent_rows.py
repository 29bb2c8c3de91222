"""What is measured of a detection is the same to the last bit, whatever detections and memory are beside it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.pose import rotated_by_matrix, rotation_matrix, transform_points
from semantic_slam.perception import uncertainty
from semantic_slam.perception.boxes.box_rays import as_places, ray_covariances
from semantic_slam.perception.boxes.box_sizes import angular_sizes
from semantic_slam.perception.cut_edges import cut_by_border
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.places_geometry import places_of_boxes
from semantic_slam.perception.points_in_space import points_of_boxes
from semantic_slam.perception.range_bearing import elevation, range_and_bearing, viewing_rays

SETTINGS = PerceptionConfiguration()
PLAIN = CameraModel(640, 480, 500.0, 510.0, 320.0, 240.0)
CAMERAS = (PLAIN, replace(PLAIN, distortion=(0.08, -0.02, 0.001, -0.0005)))
OFFSETS = (0, 1, 4, 8, 24, 40, 56)
"""Bytes by which arrays start after a cache line."""
Rows = Callable[[np.ndarray, CameraModel, np.ndarray], tuple[np.ndarray, ...]]


def boxes_of(random: np.random.Generator) -> np.ndarray:
    """(D, 4) boxes inside the image, and some that its border cuts."""
    centres = random.uniform(0.0, [640.0, 480.0], size=(int(random.integers(1, 20)), 2))
    halves = random.uniform(5.0, 60.0, size=centres.shape)
    return np.clip(np.hstack([centres - halves, centres + halves]), 0.0, [640.0, 480.0] * 2)


def pose_of(random: np.random.Generator) -> np.ndarray:
    """(7,) pose of a camera; its quaternion is not of length one, as configured extrinsics need not be."""
    return random.normal(size=7)


def moved(values: np.ndarray, offset: int) -> np.ndarray:
    """A copy that starts ``offset`` bytes after a multiple of 64."""
    memory = np.empty(values.nbytes + 128, dtype=np.uint8)
    start = -memory.ctypes.data % 64 + offset
    copy = memory[start : start + values.nbytes].view(values.dtype).reshape(values.shape)
    copy[...] = values
    return copy


def of_boxes(boxes: np.ndarray, camera: CameraModel, pose: np.ndarray) -> tuple[np.ndarray, ...]:
    cut = cut_by_border(boxes, camera)
    shown, whole = (places_of_boxes(boxes, edges, camera, pose) for edges in (None, cut))
    angles = shown.bearings_rad, shown.elevations_rad, whole.bearings_rad, whole.elevations_rad
    return *angles, viewing_rays(boxes, camera), angular_sizes(boxes, cut, camera)


def of_rays(boxes: np.ndarray, camera: CameraModel, pose: np.ndarray) -> tuple[np.ndarray, ...]:
    rays, covariances = ray_covariances(boxes, cut_by_border(boxes, camera), camera, pose, SETTINGS)
    return rays, covariances, as_places(rays, covariances)


def of_points(boxes: np.ndarray, camera: CameraModel, pose: np.ndarray) -> tuple[np.ndarray, ...]:
    cut = cut_by_border(boxes, camera)
    found = points_of_boxes(boxes, cut, 1.0 + boxes[:, 0] / 300.0, camera, pose, SETTINGS)
    return found.points, found.covariances, transform_points(pose, boxes[:, :3])


def of_samples(boxes: np.ndarray, camera: CameraModel, pose: np.ndarray) -> tuple[np.ndarray, ...]:
    samples = np.sin(boxes[:, None, :] * np.arange(1.0, 9.0)[:, None])
    return samples.mean(axis=1), uncertainty.sample_covariance(samples)


@pytest.mark.long
@pytest.mark.parametrize("rows", [of_boxes, of_rays, of_points, of_samples])
@pytest.mark.parametrize("camera", CAMERAS)
def test_each_row_is_what_it_is_alone_and_anywhere_in_memory(rows: Rows, camera: CameraModel) -> None:
    random = np.random.default_rng(0)
    for number in range(30):
        boxes, pose, offset = boxes_of(random), pose_of(random), OFFSETS[number % len(OFFSETS)]
        together = rows(boxes, camera, pose)
        for row in range(len(boxes)):
            alone = rows(moved(boxes[row : row + 1], offset), camera, moved(pose, offset))
            for whole, own in zip(together, alone, strict=True):
                np.testing.assert_array_equal(own[0], whole[row])


@pytest.mark.parametrize("camera", CAMERAS)
def test_boxes_measured_one_by_one_have_the_bearings_of_those_measured_together(camera: CameraModel) -> None:
    random = np.random.default_rng(1)
    for _ in range(30):
        boxes, pose = boxes_of(random), pose_of(random)
        places = places_of_boxes(boxes, None, camera, pose)
        bearings = [range_and_bearing(box, None, camera, pose, SETTINGS).bearing_rad for box in boxes]
        np.testing.assert_array_equal(bearings, places.bearings_rad)
        np.testing.assert_array_equal([elevation(box, camera, pose) for box in boxes], places.elevations_rad)


def test_rotations_are_sums_of_products_in_the_order_of_the_axes() -> None:
    random = np.random.default_rng(2)
    for _ in range(100):
        rotation, vectors = rotation_matrix(random.normal(size=4)), random.normal(size=(5, 3))
        exact = [[(x * a + y * b) + z * c for a, b, c in rotation.tolist()] for x, y, z in vectors.tolist()]
        np.testing.assert_array_equal(rotated_by_matrix(rotation, vectors), exact)
        np.testing.assert_array_equal(rotated_by_matrix(rotation, np.asfortranarray(vectors)), exact)
        np.testing.assert_allclose(rotated_by_matrix(rotation, vectors), vectors @ rotation.T, rtol=0.0, atol=1e-15)
