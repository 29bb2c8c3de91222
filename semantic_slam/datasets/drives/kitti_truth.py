"""What the labels of a KITTI drive tell of the objects: which move, where the others stand, what was detected."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.datasets.drives.drive import TrueObjects
from semantic_slam.datasets.drives.kitti_tracking import DetectedBoxes, LabelledBoxes
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.ground_truth import MOVING

LEAST_VIEWS = 10
"""Labelled views below which a track is too short to tell whether it moves."""
STILL_SHARE, STILL_M = 0.9, 1.0
"""An object stands still when such a share of its centres lies within so many metres of their median."""
LARGEST_DISTANCE_M = 1.5
"""Between the centres of a detected and a true box that may be of one object."""


LEAST_TRACKS = 5
"""Tracks below which labels do not tell how long the poses' metre is."""
LEAST_DRIVEN_M = 10.0
"""Way that the robot has to go while it sees an object, for that."""


@dataclass(frozen=True)
class Track:
    """One labelled object."""

    object_id: str
    type_name: str
    position: Array  # (2,) median of the centres where it stands, first centre of one that moves; metres
    num_views: int


def tracks_of(labels: LabelledBoxes, poses: Array) -> dict[int, Track]:
    """Track id -> object, in the frame of ``poses`` (K, 3), those of the body in each frame."""
    relative = np.column_stack([labels.centres[:, :2], np.zeros(len(labels.centres))])
    centres = se2.compose(poses[labels.frames], relative)[:, :2]
    tracks = {}
    for number in np.unique(labels.tracks).tolist():
        rows = np.flatnonzero(labels.tracks == number)
        middle = np.median(centres[rows], axis=0)
        near = np.linalg.norm(centres[rows] - middle, axis=1) <= STILL_M
        moves = len(rows) >= LEAST_VIEWS and near.mean() < STILL_SHARE
        name = f"{MOVING}{number}" if moves else str(number)
        tracks[number] = Track(name, labels.types[rows[0]], centres[rows[0]] if moves else middle, len(rows))
    return tracks


def metre_of(labels: LabelledBoxes, poses: Array) -> float:
    """Factor on the places of ``poses`` (K, 3) with which most of what is labelled stands still; 1 where few tell.

    Boxes are labelled in the metre of the laser. Poses from stereo pictures have one of their own: where it is longer,
    a parked car seems to move along as the robot comes near. A track's own factor is that of least squares; that of
    what moves is far off, which the median does not follow.
    """
    factors = []
    for number in np.unique(labels.tracks):
        rows = labels.tracks == number
        robot = poses[labels.frames[rows]]
        relative = np.column_stack([labels.centres[rows, :2], np.zeros(rows.sum())])
        seen = se2.compose(robot, relative)[:, :2] - robot[:, :2]
        driven = robot[:, :2] - robot[:, :2].mean(axis=0)
        if rows.sum() >= LEAST_VIEWS and np.ptp(driven, axis=0).max() >= LEAST_DRIVEN_M:
            factors.append(-float((driven * (seen - seen.mean(axis=0))).sum() / (driven**2).sum()))
    return float(np.median(factors)) if len(factors) >= LEAST_TRACKS else 1.0


def true_objects(tracks: dict[int, Track]) -> TrueObjects:
    """Objects with at least :data:`LEAST_VIEWS` labelled views."""
    known = [track for track in tracks.values() if track.num_views >= LEAST_VIEWS]
    return TrueObjects(
        tuple(track.object_id for track in known),
        tuple(track.type_name for track in known),
        np.array([track.position for track in known]).reshape(-1, 2),
    )


def associations(
    detected: DetectedBoxes, labels: LabelledBoxes, tracks: dict[int, Track], num_frames: int
) -> list[tuple[str, ...]]:
    """(num_frames,) of (D,) ids of the objects that were detected, "" where no label is near enough."""
    named = []
    for frame in range(num_frames):
        true = np.flatnonzero(labels.frames == frame)
        found = nearest_pairs(detected.centres[detected.frames == frame], labels.centres[true])
        named.append(tuple(tracks[int(labels.tracks[true[row]])].object_id if row >= 0 else "" for row in found))
    return named


def nearest_pairs(centres: Array, others: Array) -> list[int]:
    """(N,) index among ``others`` (M, 3) of ``centres`` (N, 3), -1 for none: one to one, nearest pairs first."""
    distances = np.linalg.norm(centres[:, None] - others[None], axis=2)
    found, taken = [-1] * len(centres), set()
    for pair in np.argsort(distances, axis=None, kind="stable"):
        row, column = divmod(int(pair), len(others))
        if distances[row, column] > LARGEST_DISTANCE_M:
            break
        if found[row] < 0 and column not in taken:
            found[row] = column
            taken.add(column)
    return found
