"""A drive in space: odometry in all six, what was detected and, where it is known, the truth; written as a bag."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.drive import UNKNOWN, Message, Written, detected, write_messages
from semantic_slam.datasets.frames import BODY_FRAME, CAMERA_FRAME
from semantic_slam.datasets.late_truth import tell_late_truth
from semantic_slam.datasets.space.path import SpatialPath
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthObjects
from semantic_slam.messages.inertial import imu_message
from semantic_slam.messages.standard import MAP_FRAME, OdometryEstimate, PoseEstimate
from semantic_slam.perception.frame import Detections

START_COVARIANCE = 1e-6 * np.eye(6)
"""Covariance of the pose at the start, which is where map is by definition: a millimetre, and a milliradian."""
FELT_TILT_RAD = 0.02
"""Standard deviation of roll and pitch there by accelerations, which the run is told, too."""


@dataclass(frozen=True, kw_only=True)
class PlacedObjects:
    """O objects that the source knows for certain."""

    object_ids: tuple[str, ...]  # (O,)
    class_names: tuple[str, ...]  # (O,)
    positions: Array  # (O, 3) in map, metres


@dataclass(frozen=True)
class Accelerations:
    """What an accelerometer shows along the axes of the camera's optical frame; N readings at stamps that grow."""

    stamps_ns: NDArray[np.int64]  # (N,)
    values: Array  # (N, 3) [m/s^2], upwards at rest


@dataclass(frozen=True, kw_only=True)
class SpatialDrive:
    """What an importer has read; F frames. Truth and objects are in map, odometry in a frame of its own."""

    start: Array  # (7,) T_map_body at the first odometry
    odometry: SpatialPath
    frames: list[Detections]  # (F,) at stamps that grow
    associations: list[tuple[str, ...]] | None = None  # (F,) of (D,) true ids, "" for none; None: not known
    truth: SpatialPath | None = None
    objects: PlacedObjects | None = None
    accelerations: Accelerations | None = None


def write_spatial_drive(
    drive: SpatialDrive, out: Path, title: str, max_keyframes: int | None = None, others: Iterable[Message] = ()
) -> Written:
    """Write the bag ``out``, up to the ``max_keyframes``-th frame.

    ``title`` stands before the progress bar. ``others`` are messages of the camera and whatever else the robot has, at
    stamps that grow. A line says so where the truth begins later than odometry.
    """
    if drive.truth is not None:
        truth_ns = int(drive.truth.stamps_ns[0])
        first, then = drive.odometry.poses[0], drive.odometry.since(truth_ns).poses[0]
        tell_late_truth(title, truth_ns - int(drive.odometry.stamps_ns[0]), first, then)
    frames = drive.frames[:max_keyframes]
    end_ns = frames[-1].stamp_ns if max_keyframes is not None and frames else None
    streams = [iter([_start(drive)]), _poses(drive.odometry, topics.ODOMETRY, "odom"), iter(others)]
    streams.append(detected(frames, drive.associations))
    if drive.accelerations is not None:
        streams.append(_shown(drive.accelerations))
    if drive.truth is not None:
        streams.append(_poses(drive.truth, topics.GROUND_TRUTH_ODOMETRY, MAP_FRAME))
    if drive.objects is not None:
        streams.append(iter([_objects(drive.objects, int(drive.odometry.stamps_ns[0]))]))
    counts = write_messages(streams, out, title, end_ns)
    return Written.of(counts, drive.odometry.stamps_ns, frames, end_ns)


def _start(drive: SpatialDrive) -> Message:
    stamp_ns, covariance = int(drive.odometry.stamps_ns[0]), START_COVARIANCE.copy()
    if drive.accelerations is not None:
        covariance[[3, 4], [3, 4]] = FELT_TILT_RAD**2
    return stamp_ns, topics.INITIAL_POSE, PoseEstimate(stamp_ns, MAP_FRAME, drive.start, covariance)


def _shown(told: Accelerations) -> Iterator[Message]:
    for stamp_ns, acceleration in zip(told.stamps_ns.tolist(), told.values, strict=True):
        yield stamp_ns, topics.IMU, imu_message(stamp_ns, CAMERA_FRAME, acceleration)


def _poses(path: SpatialPath, topic: str, frame_id: str) -> Iterator[Message]:
    unknown = np.broadcast_to(UNKNOWN, (len(path.poses), 6, 6))
    told = unknown if path.covariances is None else path.covariances
    for stamp_ns, pose, covariance in zip(path.stamps_ns.tolist(), path.poses, told, strict=True):
        yield stamp_ns, topic, OdometryEstimate(stamp_ns, frame_id, BODY_FRAME, pose, covariance)


def _objects(objects: PlacedObjects, stamp_ns: int) -> Message:
    poses = np.hstack([objects.positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(objects.positions), 1))])
    value = GroundTruthObjects(stamp_ns, objects.object_ids, objects.class_names, poses)
    return stamp_ns, topics.GROUND_TRUTH_OBJECTS, value
