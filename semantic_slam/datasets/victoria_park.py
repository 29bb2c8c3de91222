"""Victoria Park (Sydney): a real outdoor drive past tree trunks, as a bag of odometry and range-bearing measurements.

The data set ships with gtsam as a text file of ``ODOMETRY i j dx dy dtheta cov`` (T_i_j, metres and radians) and
``LANDMARK pose landmark x y cov`` (position of a trunk in the robot's frame). Poses and landmarks share one index
space and time is missing: poses are recognised by the odometry chain and spread evenly over the known duration. The
landmark numbers are an earlier system's association: they travel as ground truth only.
"""

import importlib.util
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle

DURATION_S = 1548.6
"""Length of the drive: 0.222 s per pose on average."""
START_NS = 1_000_000_000
"""Stamp of the first pose; the file has none, and zero means "no stamp" to many tools."""
FULL_LENGTH = 6969
"""Poses of the whole drive."""


@dataclass(frozen=True)
class Observation:
    """One trunk seen from one pose."""

    pose: int  # 0, 1, 2, ... along the drive
    landmark: str  # number in the file
    position: Array  # (2,) x y in the robot's frame, metres


@dataclass(frozen=True)
class Log:
    """The whole file; K poses."""

    increments: Array  # (K - 1, 3) T_k_k+1: dx dy [m] dtheta [rad]
    observations: tuple[Observation, ...]  # in the order of the drive

    @property
    def num_poses(self) -> int:
        return len(self.increments) + 1

    def by_pose(self) -> list[list[Observation]]:
        """(K,) what was seen from every pose; an empty list where nothing was."""
        seen: list[list[Observation]] = [[] for _ in range(self.num_poses)]
        for observation in self.observations:
            seen[observation.pose].append(observation)
        return seen


def example_path() -> Path:
    """The file inside the gtsam wheel, found without loading the library; raises InputError."""
    package = importlib.util.find_spec("gtsam")
    locations = package.submodule_search_locations if package else None
    for folder in locations or ():
        path = Path(folder) / "Data" / "victoria_park.txt"
        if path.is_file():
            return path
    raise InputError("victoria_park.txt: not found in the gtsam package; install gtsam 4.3 from PyPI or name the file")


def read_log(path: Path) -> Log:
    """Read the text file; raises InputError with the line that is wrong."""
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as fault:
        raise InputError(f"{path}: cannot be read ({fault}); name a victoria_park.txt") from None
    pose_of = {0: 0}
    increments: list[list[float]] = []
    rows: list[tuple[int, str, list[float]]] = []
    for number, line in enumerate(lines, start=1):
        try:
            _read_line(line.split(), pose_of, increments, rows)
        except (ValueError, KeyError, IndexError):
            raise InputError(
                f"{path}, line {number}: no ODOMETRY or LANDMARK of known poses; name a victoria_park.txt"
            ) from None
    if not rows:
        raise InputError(f"{path}: no LANDMARK lines; name a victoria_park.txt")
    observations = tuple(
        Observation(pose, landmark, np.array(xy)) for pose, landmark, xy in sorted(rows, key=lambda row: row[0])
    )
    return Log(np.array(increments).reshape(-1, 3), observations)


def _read_line(
    words: list[str],
    pose_of: dict[int, int],
    increments: list[list[float]],
    rows: list[tuple[int, str, list[float]]],
) -> None:
    if not words:
        return
    if words[0] == "ODOMETRY":
        pose = pose_of[int(words[1])] + 1
        if pose != len(pose_of):
            raise ValueError("odometry must be one chain")
        pose_of[int(words[2])] = pose
        increments.append(_finite(words[3:6], 3))
    elif words[0] == "LANDMARK":
        rows.append((pose_of[int(words[1])], str(int(words[2])), _finite(words[3:5], 2)))
    else:
        raise ValueError(words[0])


def _finite(words: list[str], number: int) -> list[float]:
    values = [float(word) for word in words]
    if len(values) != number or not np.isfinite(values).all():
        raise ValueError(words)
    return values


def dead_reckoning(increments: Array) -> Array:
    """(K, 3) planar poses in odom, from (K - 1, 3) increments in the frame of the pose before each."""
    yaw = np.concatenate([[0.0], np.cumsum(increments[:, 2])])
    cos, sin = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    steps = np.stack(
        [cos * increments[:, 0] - sin * increments[:, 1], sin * increments[:, 0] + cos * increments[:, 1]], axis=1
    )
    position = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([position, wrap_angle(yaw)])


def stamps(num_poses: int) -> NDArray[np.int64]:
    """(K,) nanoseconds, evenly spaced so that the whole drive takes :data:`DURATION_S`."""
    seconds = np.arange(num_poses) * (DURATION_S / (FULL_LENGTH - 1))
    return START_NS + np.round(seconds * 1e9).astype(np.int64)


def range_bearing(positions: Array, variance_m2: float) -> tuple[Array, Array, Array]:
    """Ranges (D,), bearings (D,) and covariances (D, 2, 2) of [range, bearing] of positions (D, 2).

    A position with covariance v I has, to first order, range variance v and bearing variance v / range^2, uncorrelated:
    the Jacobian of polar coordinates is a rotation, scaled by 1 / range in its second row.
    """
    ranges = np.hypot(positions[:, 0], positions[:, 1])
    bearings = np.arctan2(positions[:, 1], positions[:, 0])
    covariances = np.zeros((len(positions), 2, 2))
    covariances[:, 0, 0] = variance_m2
    covariances[:, 1, 1] = variance_m2 / ranges**2
    return ranges, bearings, covariances
