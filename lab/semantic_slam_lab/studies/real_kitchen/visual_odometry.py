"""Odometry of a camera with depth from its pictures alone: ORB features, PnP against the last reference picture.

A picture becomes the reference of those after it once too few of its features are found again. Each has the pose that
PnP with RANSAC finds between its pixels and the reference's points in space; where that fails the camera is taken to
move on as it did (Rublee et al., ICCV 2011; Lepetit et al., IJCV 2009).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import CameraModel

FEATURES = 2000
LARGEST_RATIO = 0.8
"""A feature's best match counts when its distance is below this share of that to the second best (Lowe, IJCV 2004)."""
LEAST_MATCHES = 12
"""Without so many inliers PnP has failed."""
REFERENCE_SHARE = 0.4
"""A picture in which fewer of the reference's features are found again becomes the reference."""
FARTHEST_M = 4.0
"""Structured light tells too little of what is farther."""
REPROJECTION_PX = 2.0


@dataclass(frozen=True)
class Seen:
    """N features of a picture that have depth."""

    pixels: Array  # (N, 2)
    points: Array  # (N, 3) in the optical frame
    descriptors: NDArray[np.uint8]  # (N, 32)


def visual_odometry(folder: ImageFolder, seed: int) -> tuple[Array, int]:
    """(F, 4, 4) poses of the optical frame in that of the first picture, and in how many of them PnP failed.

    Raises InputError for pictures that cannot be read.
    """
    cv2.setRNGSeed(seed)
    poses, failures = [np.eye(4)], 0
    reference, T_world_reference, most = features_of(folder, 0), np.eye(4), 0
    for index in tqdm(range(1, len(folder.frames)), desc="visual odometry", unit="image"):
        seen = features_of(folder, index)
        guess = np.linalg.inv(_moved_on(poses)) @ T_world_reference
        motion, inliers = relative_pose(reference, seen, folder.camera, guess)
        if motion is None:  # not even against the reference
            reference, T_world_reference, most = features_of(folder, index - 1), poses[-1], 0
            motion, inliers = relative_pose(reference, seen, folder.camera, np.eye(4))
        failures += motion is None
        poses.append(_moved_on(poses) if motion is None else T_world_reference @ np.linalg.inv(motion))
        most = max(most, inliers)
        if inliers < REFERENCE_SHARE * most or motion is None:
            reference, T_world_reference, most = seen, poses[-1], 0
    return np.array(poses), failures


def features_of(folder: ImageFolder, index: int) -> Seen:
    """ORB features of a picture, with their places by depth. Raises InputError."""
    frame, camera = folder.frames[index], folder.camera
    grey = cv2.cvtColor(frame.image(), cv2.COLOR_RGB2GRAY)
    keypoints, descriptors = cv2.ORB.create(FEATURES).detectAndCompute(grey, None)
    pixels = np.array([keypoint.pt for keypoint in keypoints]).reshape(-1, 2)
    columns, rows = np.rint(pixels).astype(int).T
    depth = folder.depth_m(frame)[rows, columns].astype(np.float64)
    known = np.isfinite(depth) & (depth <= FARTHEST_M)
    scaled = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy] * depth[:, None]
    points = np.column_stack([scaled, depth])
    if descriptors is None:
        return Seen(np.zeros((0, 2)), np.zeros((0, 3)), np.zeros((0, 32), dtype=np.uint8))
    return Seen(pixels[known], points[known], np.asarray(descriptors[known], dtype=np.uint8))


def relative_pose(reference: Seen, seen: Seen, camera: CameraModel, guess: Array) -> tuple[Array | None, int]:
    """(4, 4) T_seen_reference and the number of inliers; None where PnP fails."""
    pairs = matches(reference.descriptors, seen.descriptors)
    if len(pairs) < LEAST_MATCHES:
        return None, 0
    points, pixels = reference.points[pairs[:, 0]], seen.pixels[pairs[:, 1]]
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    start, shift = cv2.Rodrigues(guess[:3, :3])[0], guess[:3, 3:].copy()
    found, turn, shift, inliers = cv2.solvePnPRansac(
        points, pixels, matrix, None, start, shift, True, 300, REPROJECTION_PX, 0.999
    )
    if not found or inliers is None or len(inliers) < LEAST_MATCHES:
        return None, 0
    rows = inliers.ravel()
    turn, shift = cv2.solvePnPRefineLM(points[rows], pixels[rows], matrix, None, turn, shift)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = cv2.Rodrigues(turn)[0], shift.ravel()
    return motion, len(rows)


def matches(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.intp]:
    """(M, 2) rows of features that are each other's best match, and clearly so."""
    if len(first) < 2 or len(second) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(second, first)}
    best = [
        (one.queryIdx, one.trainIdx)
        for one, other in matcher.knnMatch(first, second, 2)
        if one.distance < LARGEST_RATIO * other.distance and back[one.trainIdx] == one.queryIdx
    ]
    return np.array(best, dtype=np.intp).reshape(-1, 2)


def _moved_on(poses: list[Array]) -> Array:
    """The next pose of a camera that moves as it did last."""
    return poses[-1] if len(poses) < 2 else poses[-1] @ np.linalg.inv(poses[-2]) @ poses[-1]
