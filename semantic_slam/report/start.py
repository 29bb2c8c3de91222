"""Start of a run as it was used, which need not be the one of its configuration."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.configuration import from_dict
from semantic_slam.errors import InputError
from semantic_slam.evaluation.history import best_index
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.geometry.so3 import matrix
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import initial_pose_of
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.pipeline.start import without_tilt
from semantic_slam.report.wording import number

CONFIGURED, LEVELLED, OPEN_TILT = "configuration", "configuration and gravity", "configuration, roll and pitch open"
TOLD, UNKNOWN = "told", ""
SAID = {
    CONFIGURED: "from the configuration",
    LEVELLED: "from the configuration, roll and pitch from gravity",
    OPEN_TILT: "from the configuration, roll and pitch left open, as imu told too little at the first keyframe",
    TOLD: "told on topic initialpose or by a program, in place of the configuration's",
    UNKNOWN: "source not recorded",
}
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
UNITS = ("m", "m", "m", "rad", "rad", "rad")
KNOWN_TILT_RAD = 0.2
"""Standard deviation of roll or pitch at the end of a run up to which gravity counts as measured."""
PLANAR = (0, 1, 5)
"""Indices of x, y and yaw."""


@dataclass(frozen=True)
class Start:
    """The prior of the robot's pose in map, before the motion of the first keyframe."""

    pose: Array  # (7,)
    covariance: Array  # (6, 6)
    source: str  # CONFIGURED, LEVELLED, OPEN_TILT, TOLD or UNKNOWN

    def text(self, *, planar: bool) -> str:
        """Value and standard deviation of each coordinate that is estimated, and where they come from."""
        axes = PLANAR if planar else range(6)
        values, sigmas = _coordinates(self.pose), np.sqrt(np.diag(self.covariance))
        told = [f"{AXES[n]} {number(float(values[n]))} ± {sigmas[n]:.2g} {UNITS[n]}" for n in axes]
        return f"{', '.join(told)}; {SAID[self.source]}"


def start_of(run: RunConfiguration, configuration: dict[str, Any]) -> Start:
    """The start that ``run`` used; its source is found by comparison with the ``configuration`` of that run."""
    return Start(run.initial_pose, run.initial_covariance, _source(run, configuration))


def open_tilt(start: Start, last: HybridBelief) -> str:
    """A sentence where roll and pitch were open at the ``start`` and are little better known in the ``last`` belief."""
    sigma_rad = np.sqrt(np.linalg.eigvalsh(last.pose_covariances[best_index(last)][3:5, 3:5])[-1])
    if start.source != OPEN_TILT or sigma_rad <= KNOWN_TILT_RAD:
        return ""
    return (
        "Gravity was hardly measured: roll and pitch were left open at the start, and in the end are known to"
        f" ± {sigma_rad:.2g} rad, and so is how level the map is."
    )


def _source(run: RunConfiguration, configuration: dict[str, Any]) -> str:
    try:
        told: dict[str, Any] = {
            name: configuration[name] for name in ("state_space", "initial_pose") if name in configuration
        }
        pose, covariance = initial_pose_of(from_dict(told))
    except InputError:
        return UNKNOWN
    if "initial_pose" not in told:
        return UNKNOWN
    if np.allclose(run.initial_pose, pose) and np.allclose(run.initial_covariance, covariance):
        return CONFIGURED
    is_open = np.allclose(run.initial_covariance, without_tilt(covariance))
    if not is_open or not np.allclose(run.initial_pose[:3], pose[:3]):
        return TOLD
    return OPEN_TILT if np.allclose(run.initial_pose, pose) else LEVELLED


def _coordinates(pose: Array) -> Array:
    """(6,) x, y, z [m], roll, pitch, yaw [rad], turns about x, then y, then z of map (REP-103)."""
    turn = matrix(pose[3:])
    roll, pitch = np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(np.clip(turn[2, 0], -1.0, 1.0))
    return np.array([*pose[:3], roll, pitch, planar_from_pose_vector(pose)[2]])
