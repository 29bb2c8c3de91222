"""Where things stand in space, by given poses alone: medians of places by depth, or where rays nearly meet."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.datasets.space.drive import SpatialDrive
from semantic_slam.evaluation.trajectory import Trajectory, interpolate
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.perception.boxes.box_sizes import pixel_rays
from semantic_slam.perception.cut_edges import cut_by_border
from semantic_slam.perception.frame import CameraModel, Detections


def true_poses(drive: SpatialDrive, frames: Sequence[Detections]) -> Array:
    """(F, 7) of the body at the frames."""
    assert drive.truth is not None
    stamps = np.array([frame.stamp_ns for frame in frames], dtype=np.int64)
    return interpolate(Trajectory(drive.truth.stamps_ns, drive.truth.poses), stamps)


def places(drive: SpatialDrive, frames: Sequence[Detections], label: str) -> Array:
    """(N, 3) in map of all detections of a label that depth places, under the true poses."""
    found = [np.zeros((0, 3))]
    for frame, pose in zip(frames, true_poses(drive, frames), strict=True):
        rows = [row for row, own in enumerate(frame.labels) if own == label]
        told = frame.positions[rows]
        told = told[np.isfinite(told).all(axis=1)]
        found.append(pose[:3] + so3.rotated(pose[3:], told))
    return np.concatenate(found)


def meeting_point(
    drive: SpatialDrive, frames: Sequence[Detections], camera: CameraModel, T_body_camera: Array
) -> Array:
    """(3,) in map that is nearest, by least squares, to the rays of all boxes that the border does not cut."""
    matrix, vector = np.zeros((3, 3)), np.zeros(3)
    for frame, pose in zip(frames, true_poses(drive, frames), strict=True):
        whole = frame.boxes[~cut_by_border(frame.boxes, camera).any(axis=(1, 2))]
        rays = pixel_rays(0.5 * (whole[:, :2] + whole[:, 2:]), camera) @ rotation_matrix(T_body_camera[3:]).T
        for ray in so3.rotated(pose[3:], rays) if np.isfinite(pose).all() else ():
            across = np.eye(3) - np.outer(ray, ray)
            matrix += across
            vector += across @ pose[:3]
    return np.asarray(np.linalg.solve(matrix, vector))
