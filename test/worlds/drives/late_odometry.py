"""A robot that stops and turns among standing objects, its odometry stamped by another clock than its detections."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.configuration import from_dict
from semantic_slam.datasets.victoria_park_import import measurements
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.building import make_run_configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler

START_NS = 10**18
TURN_RAD_S, SPEED_M_S, PHASE_S = 0.8, 0.4, 2.0
ODOMETRY_HZ, DETECTION_HZ = 20, 4
SIGMA_M = 0.04  # of each detected place, in x and y
REGION = {"min_range_m": 0.3, "max_range_m": 5.0, "field_of_view_rad": 2.0}


@dataclass(frozen=True)
class LateDrive:
    """Keyframes at which detections were taken, and the true poses (K, 3) then."""

    run: RunConfiguration
    keyframes: list[Keyframe]
    truth: Array


def true_pose(time_s: float, turns: float = 1.0) -> Array:
    """Driving ahead and turning on the spot by turns; at rest before 0. ``turns``: factor on every turn."""
    pose, left = np.zeros(3), max(time_s, 0.0)
    phase = 0
    while left > 0.0:
        span = min(left, PHASE_S)
        turn = TURN_RAD_S if phase % 4 == 1 else -0.6 * TURN_RAD_S
        twist = np.array([SPEED_M_S, 0.0, 0.0]) if phase % 2 == 0 else np.array([0.0, 0.0, turns * turn])
        pose = se2.compose(pose, se2.exp(span * twist))
        left, phase = left - span, phase + 1
    return np.asarray(pose)


def late_drive(
    offset_s: float,
    sigma_offset_s: float,
    duration_s: float = 20.0,
    seed: int = 0,
    expected_s: float = 0.0,
    turn_scale: float = 0.0,
    odometry: dict[str, Any] | None = None,
    **settings: Any,
) -> LateDrive:
    """Odometry stamped ``offset_s`` later than detections of the same instant, where ``expected_s`` is expected.

    It leaves out the share ``turn_scale`` of every turn that it tells.
    """
    random = np.random.default_rng(seed)
    configuration = from_dict(
        {
            "association": "open",
            "semantic_model": {"kind": "none"},
            "open_world": {"iterate_updates": False, "detection_probability": 0.9, **REGION},
            "odometry": {
                "estimate_bias": True,
                "clock_offset_s": expected_s,
                "sigma_clock_offset_s": sigma_offset_s,
                "sigma_rotation_per_rad": 0.02,
                **(odometry or {}),
            },
            "pruning": {"max_hypotheses": 4},
            **settings,
        }
    )
    assembler = KeyframeAssembler(configuration)
    for number in range(int((duration_s + 1.0) * ODOMETRY_HZ)):
        stamp_s = number / ODOMETRY_HZ
        pose = pose_vector_from_planar(true_pose(stamp_s - offset_s - 1.0, 1.0 / (1.0 + turn_scale)))
        estimate = OdometryEstimate(START_NS + round(1e9 * stamp_s), "odom", "base_link", pose, np.eye(6))
        assembler.add_odometry(to_message(estimate))
    objects, truth = random.uniform(-4.0, 5.0, size=(15, 2)), []
    for number in range(int(duration_s * DETECTION_HZ) - DETECTION_HZ):
        time_s = number / DETECTION_HZ
        truth.append(true_pose(time_s))
        seen = _seen(truth[-1], objects, random)
        assembler.add_measurements(measurements(seen, START_NS + round(1e9 * (time_s + 1.0)), number, SIGMA_M**2))
    start = pose_vector_from_planar(np.zeros(3)), covariance_from_planar(1e-6 * np.eye(3))
    run = make_run_configuration(configuration, None, *start, stamp_ns=START_NS)
    return LateDrive(run, assembler.flush(), np.array(truth))


def _seen(pose: Array, objects: Array, random: np.random.Generator) -> Array:
    """(D, 2) detected places in the robot's frame."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    places = (objects - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])
    bearing, distance = np.arctan2(places[:, 1], places[:, 0]), np.hypot(*places.T)
    inside = (distance < 4.8) & (distance > 0.5) & (np.abs(bearing) < 0.95) & (random.random(len(places)) < 0.9)
    return places[inside] + random.normal(scale=SIGMA_M, size=(int(inside.sum()), 2))
