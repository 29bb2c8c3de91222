"""A drive: planar odometry, what was detected and, where it is known, the truth; written as a bag."""

import heapq
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from semantic_slam.bag.writer import BagWriter
from semantic_slam.datasets.frames import BODY_FRAME
from semantic_slam.datasets.late_truth import tell_late_truth
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects
from semantic_slam.messages.standard import MAP_FRAME, OdometryEstimate
from semantic_slam.perception.frame import Detections

Message = tuple[int, str, Any]
"""Stamp [ns], topic, message."""

UNKNOWN = np.zeros((6, 6))
"""Covariance of a pose whose uncertainty the source does not state."""


@dataclass(frozen=True)
class Path2D:
    """N planar poses in one frame, at stamps that grow."""

    stamps_ns: NDArray[np.int64]  # (N,)
    poses: Array  # (N, 3) x y [m] yaw [rad]

    def moved(self, T_to_from: Array) -> "Path2D":
        """The path in the frame in which the present one has the pose (3,)."""
        return Path2D(self.stamps_ns, se2.compose(T_to_from, self.poses))

    def since(self, stamp_ns: int) -> "Path2D":
        """The path from the last pose at or before a stamp on; the whole one where it begins later."""
        first = max(int(np.searchsorted(self.stamps_ns, stamp_ns, side="right")) - 1, 0)
        return Path2D(self.stamps_ns[first:], self.poses[first:])


@dataclass(frozen=True)
class TrueObjects:
    """O objects that the source knows for certain; ids of those that move begin with ``MOVING``."""

    object_ids: tuple[str, ...]  # (O,)
    class_names: tuple[str, ...]  # (O,)
    positions: Array  # (O, 2) x y [m]; of a moving one where it was first known


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What an importer has read; F frames. Truth and objects share a frame, odometry has its own."""

    odometry: Path2D
    frames: list[Detections]  # (F,) at stamps that grow
    associations: list[tuple[str, ...]] | None = None  # (F,) of (D,) true ids, "" for none; None: not known
    truth: Path2D | None = None
    objects: TrueObjects | None = None


def since(drive: Drive, stamp_ns: int) -> Drive:
    """The drive from a stamp on: odometry and truth from their last poses at or before it, and later frames."""
    first = next((row for row, frame in enumerate(drive.frames) if frame.stamp_ns >= stamp_ns), len(drive.frames))
    return replace(
        drive,
        odometry=drive.odometry.since(stamp_ns),
        frames=drive.frames[first:],
        associations=None if drive.associations is None else drive.associations[first:],
        truth=None if drive.truth is None else drive.truth.since(stamp_ns),
    )


@dataclass(frozen=True)
class Written:
    """What a bag holds."""

    poses: int  # of odometry
    seconds: float
    frames: int
    detections: int
    pictures: int = 0

    @classmethod
    def of(
        cls, counts: Counter[str], odometry_ns: NDArray[np.int64], frames: list[Detections], end_ns: int | None
    ) -> "Written":
        """From messages by topic, stamps of odometry and frames; ``end_ns``: where the bag was ended, None: nowhere."""
        last_ns = int(odometry_ns[-1]) if end_ns is None else end_ns
        return cls(
            counts[topics.ODOMETRY],
            float(last_ns - odometry_ns[0]) / 1e9,
            len(frames),
            sum(map(len, frames)),
            counts[topics.IMAGE_COMPRESSED],
        )

    def __str__(self) -> str:
        drive = f"{self.poses} poses in {self.seconds:.1f} s"
        return f"{drive}, {self.frames} frames with {self.detections} detections, {self.pictures or 'no'} pictures"


def write_drive(
    drive: Drive,
    out: Path,
    title: str,
    max_keyframes: int | None = None,
    pictures: Iterable[Message] = (),
) -> Written:
    """Write the bag ``out``, up to the ``max_keyframes``-th frame; truth in the frame of the first true pose.

    ``title`` stands before the progress bar. The first true pose is the last one that is not after the odometry's
    first; a line says so where truth begins later. ``pictures`` are stamps, topics and messages of the camera, at
    stamps that grow.
    """
    drive = in_frame_of_start(drive)
    if drive.truth is not None:
        truth_ns = int(drive.truth.stamps_ns[0])
        ends = np.stack([drive.odometry.poses[0], drive.odometry.since(truth_ns).poses[0]])
        tell_late_truth(title, truth_ns - int(drive.odometry.stamps_ns[0]), *pose_vector_from_planar(ends))
    frames = drive.frames[:max_keyframes]
    end_ns = frames[-1].stamp_ns if max_keyframes is not None and frames else None
    per_frame = 1 if drive.associations is None else 2
    total = len(drive.odometry.stamps_ns) + per_frame * len(frames) + (len(drive.truth.stamps_ns) if drive.truth else 0)
    known = None if pictures else total  # of pictures nobody knows how many there are before they are read
    counts = write_messages([iter(pictures), *_streams(drive, len(frames))], out, title, end_ns, known)
    return Written.of(counts, drive.odometry.stamps_ns, frames, end_ns)


def write_messages(
    streams: Iterable[Iterator[Message]], out: Path, title: str, end_ns: int | None, total: int | None = None
) -> Counter[str]:
    """Write the bag ``out`` of what comes until a stamp, each stream in its order; returns messages by topic."""
    counts: Counter[str] = Counter()
    entries = heapq.merge(*streams, key=lambda entry: entry[0])
    with BagWriter(out) as bag:
        for stamp_ns, topic, value in tqdm(entries, total=total, desc=title, unit="message"):
            if end_ns is not None and stamp_ns > end_ns:
                break
            bag.write(topic, value, stamp_ns)
            counts[topic] += 1
    return counts


def in_frame_of_start(drive: Drive) -> Drive:
    """The drive with its truth, from the start of odometry on, and objects in the frame of the first true pose."""
    if drive.truth is None:
        return drive
    truth = drive.truth.since(int(drive.odometry.stamps_ns[0]))
    T_start_source = se2.inverse(truth.poses[0])
    objects = drive.objects
    if objects is not None:
        poses = np.column_stack([objects.positions, np.zeros(len(objects.positions))])
        objects = TrueObjects(objects.object_ids, objects.class_names, se2.compose(T_start_source, poses)[:, :2])
    return Drive(
        odometry=drive.odometry,
        frames=drive.frames,
        associations=drive.associations,
        truth=truth.moved(T_start_source),
        objects=objects,
    )


def _streams(drive: Drive, num_frames: int) -> list[Iterator[Message]]:
    """Each topic's messages with their stamps, in order."""
    streams = [_poses(drive.odometry, topics.ODOMETRY, "odom"), detected(drive.frames[:num_frames], drive.associations)]
    if drive.truth is not None:
        streams.append(_poses(drive.truth, topics.GROUND_TRUTH_ODOMETRY, MAP_FRAME))
    if drive.objects is not None:
        streams.append(iter([_objects(drive.objects, int(drive.odometry.stamps_ns[0]))]))
    return streams


def _poses(path: Path2D, topic: str, frame_id: str) -> Iterator[Message]:
    for stamp_ns, pose in zip(path.stamps_ns.tolist(), pose_vector_from_planar(path.poses), strict=True):
        yield stamp_ns, topic, OdometryEstimate(stamp_ns, frame_id, BODY_FRAME, pose, UNKNOWN)


def detected(frames: list[Detections], associations: list[tuple[str, ...]] | None) -> Iterator[Message]:
    """The messages of frames, and of what is truly seen in each."""
    for index, detections in enumerate(frames):
        yield detections.stamp_ns, topics.DETECTIONS, detections
        if associations is not None:
            truth = GroundTruthAssociations(detections.stamp_ns, associations[index])
            yield detections.stamp_ns, topics.GROUND_TRUTH_ASSOCIATIONS, truth


def _objects(objects: TrueObjects, stamp_ns: int) -> Message:
    poses = pose_vector_from_planar(np.column_stack([objects.positions, np.zeros(len(objects.positions))]))
    value = GroundTruthObjects(stamp_ns, objects.object_ids, objects.class_names, poses)
    return stamp_ns, topics.GROUND_TRUTH_OBJECTS, value
