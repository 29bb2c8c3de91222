"""One drive of KITTI tracking: detected boxes, true boxes with track ids, and camera poses.

Geiger, Lenz, Urtasun: "Are we ready for autonomous driving? The KITTI vision benchmark suite", CVPR 2012. The camera's
axes are x right, y down, z forward; boxes stand on their locations. The body is the camera, its axes those of REP-103:
x is the camera's z, y its -x, z its -y.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives.tables import Line, found, found_or_none, lines_of, numbers, table
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index

REMEDY = "name a folder with whole det_NNNN.txt, label_NNNN.txt and orb_NNNN.txt"
DETECTED = (
    "frame",
    "type",
    "x_min",
    "y_min",
    "x_max",
    "y_max",
    "score",
    "h",
    "w",
    "l",
    "x",
    "y",
    "z",
    "heading",
    "alpha",
)
TYPES = {1: "Pedestrian", 2: "Car", 3: "Cyclist"}
LABELLED = ("frame", "track", "type", "truncated", "occluded", "alpha", "x_min", "y_min", "x_max", "y_max")
SIZED = ("h", "w", "l", "x", "y", "z", "heading")
NOT_AN_OBJECT = "DontCare"
LEAST_OVERLAP = {"Pedestrian": 0.5, "Car": 0.7, "Cyclist": 0.5}
"""Intersection over union from which on the benchmark takes a box of that type to be right."""
LEAST_HEIGHT_PX = 25.0
"""Height in the picture from which on the benchmark asks for a box, but for its easiest third."""
BEST_M = 0.1
"""Standard deviation of a centre, to each side, that no box is known better than."""


@dataclass(frozen=True)
class DetectedBoxes:
    """N boxes that a detector reported."""

    frames: Index  # (N,)
    types: tuple[str, ...]  # (N,)
    boxes: Array  # (N, 4) pixels
    scores: Array  # (N,) 0..1
    centres: Array  # (N, 3) in the body frame, metres
    covariances: Array  # (N, 3, 3) of the centres, of boxes that the benchmark takes to be right


@dataclass(frozen=True)
class LabelledBoxes:
    """N true boxes, without those regions that nobody labelled."""

    frames: Index  # (N,)
    tracks: Index  # (N,)
    types: tuple[str, ...]  # (N,)
    centres: Array  # (N, 3) in the body frame, metres


def read_poses(folder: Path, drive: str) -> Array:
    """(K, 3) planar poses of the body in the frame of the file, one per picture. Raises InputError."""
    columns = [f"{row}{column}" for row in "xyz" for column in ("x", "y", "z", "t")]
    path = found(folder, f"orb_{drive}.txt")
    matrices = table(path, columns, REMEDY, time=False).reshape(-1, 3, 4)
    if len(matrices) < 2:
        raise InputError(f"{path}: one pose, and no motion; {REMEDY}")
    ahead = matrices[:, :, 2]
    return np.column_stack([matrices[:, 2, 3], -matrices[:, 0, 3], np.arctan2(-ahead[:, 0], ahead[:, 2])])


def read_detected(folder: Path, drive: str, num_frames: int) -> DetectedBoxes:
    """The detector's boxes; its raw scores s become confidences 1 / (1 + exp(-s)). Raises InputError."""
    path = found(folder, f"det_{drive}.txt")
    rows: list[list[float]] = []
    types: list[str] = []
    for line in lines_of(path, REMEDY, ","):
        row = numbers(line, DETECTED, REMEDY)
        _check_frame(line, int(row[0]), int(rows[-1][0]) if rows else 0, num_frames)
        if int(row[1]) not in TYPES:
            raise line.fault(f"type {row[1]:g} is none of {', '.join(map(str, TYPES))}", REMEDY)
        types.append(TYPES[int(row[1])])
        rows.append(row)
    values = np.array(rows).reshape(-1, len(DETECTED))
    scores = 1.0 / (1.0 + np.exp(-values[:, 6]))
    return DetectedBoxes(
        frames=values[:, 0].astype(int),
        types=tuple(types),
        boxes=values[:, 2:6],
        scores=scores,
        centres=_centres(values[:, 7:13]),
        covariances=centre_covariances(values[:, 7:10], values[:, 13], types, values[:, 5] - values[:, 3]),
    )


def read_labelled(folder: Path, drive: str, num_frames: int) -> LabelledBoxes | None:
    """The true boxes; None where there is no file of them. Raises InputError."""
    path = found_or_none(folder, f"label_{drive}.txt")
    if path is None:
        return None
    frames: list[int] = []
    tracks: list[int] = []
    types: list[str] = []
    sizes: list[list[float]] = []
    for line in lines_of(path, REMEDY):
        if len(line.words) != len(LABELLED) + len(SIZED):
            raise line.fault(f"{len(line.words)} columns, expected {' '.join(LABELLED + SIZED)}", REMEDY)
        kind = line.words.pop(2)
        row = numbers(line, (*LABELLED[:2], *LABELLED[3:], *SIZED), REMEDY)
        _check_frame(line, int(row[0]), frames[-1] if frames else 0, num_frames)
        if kind != NOT_AN_OBJECT:
            frames.append(int(row[0]))
            tracks.append(int(row[1]))
            types.append(kind)
            sizes.append(row[9:15])
    centres = _centres(np.array(sizes).reshape(-1, 6))
    return LabelledBoxes(np.array(frames, dtype=int), np.array(tracks, dtype=int), tuple(types), centres)


def _check_frame(line: Line, frame: int, before: int, num_frames: int) -> None:
    if frame < before:
        raise line.fault(f"time goes backwards, from frame {before} to {frame}", "sort its lines")
    if frame >= num_frames:
        raise line.fault(f"frame {frame}, but there are {num_frames} poses", REMEDY)


def _centres(sizes: Array) -> Array:
    """(N, 3) centres in the body frame of boxes h w l x y z (N, 6), whose y is that of the bottom."""
    return np.column_stack([sizes[:, 5], -sizes[:, 3], 0.5 * sizes[:, 0] - sizes[:, 4]])


def centre_covariances(sizes: Array, headings_rad: Array, types: Sequence[str], heights_px: Array) -> Array:
    """(N, 3, 3) in the body frame, of the centres of boxes h w l (N, 3) with headings (N,) about the camera's y.

    A detector is made to find boxes that the benchmark takes to be right, so that nearly all of its boxes are, down to
    the least height (N,) in the picture that the benchmark asks for: one that is off by a share d of its own length or
    width overlaps the true one by (1 - d) / (1 + d), and the least overlap is two standard deviations away there. The
    laser's points on a thing become fewer with the square of its distance, so that a centre fitted to them is known as
    much better as the box is larger; to a decimetre at best.
    """
    overlap = np.array([LEAST_OVERLAP[name] for name in types])
    share = 0.5 * (1.0 - overlap) / (1.0 + overlap) * LEAST_HEIGHT_PX / np.maximum(heights_px, 1.0)
    height, width, length = (sizes * share[:, None]).T
    sine, cosine, zero, one = np.sin(headings_rad), np.cos(headings_rad), np.zeros(len(types)), np.ones(len(types))
    along = np.stack([-sine, -cosine, zero], axis=-1)
    across = np.stack([cosine, -sine, zero], axis=-1)
    up = np.stack([zero, zero, one], axis=-1)
    slopes = np.stack([along * length[:, None], across * width[:, None], up * height[:, None]], axis=-1)
    return np.asarray(slopes @ np.swapaxes(slopes, 1, 2) + BEST_M**2 * np.eye(3))
