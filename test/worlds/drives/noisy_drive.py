"""A robot on a round course among posts, as a bag: odometry errs as much as one says, and detections do."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from worlds.belief_factory import odometry_message

from semantic_slam.bag.writer import BagWriter
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.perception.frame import Detections

START = 1_700_000_000 * NANOSECONDS
PERIOD = NANOSECONDS
STEP = np.array([0.4, 0.0, 0.1])
SIGMAS = np.array([0.02, 0.02, 0.01])  # of a step of odometry in x, y [m] and yaw [rad], where it is honest
SIGMA_RANGE, SIGMA_BEARING = 0.08, 0.02
REACH_M, HALF_ANGLE = 6.0, 1.0
NUM_POSTS = 40
STATED: dict[str, Any] = {
    "association": "open",
    "semantic_model": {"kind": "none"},
    "odometry": {
        "sigma_translation_per_m": 0.05, "sigma_rotation_per_m": 0.025, "sigma_rotation_per_rad": 0.0,
        "sigma_translation_floor_m": 1e-4, "sigma_rotation_floor_rad": 1e-4,
        "estimate_bias": True, "sigma_bias_rad_per_m": 0.05, "sigma_bias_scale": 0.05,
    },
    "perception": {"sigma_range_m": SIGMA_RANGE, "sigma_bearing_rad": SIGMA_BEARING},
    "open_world": {
        "detection_probability": 0.9, "clutter_per_frame": 0.1, "birth_density": 0.15, "occluder_radius_m": 0.0,
        "max_range_m": REACH_M, "min_range_m": 0.5, "field_of_view_rad": 2.0 * HALF_ANGLE, "iterate_updates": False,
    },
    "initial_pose": {"mean": [0.0, 0.0, 0.0], "sigma": [0.01, 0.01, 0.01]},
    "pruning": {"max_hypotheses": 6},
    "weights": {"max_candidates": 5},
}  # fmt: skip
"""What holds of the drive while odometry is honest: 0.05 and 0.025 a metre are SIGMAS a step."""


@dataclass(frozen=True)
class Noise:
    """What the robot of a drive is really like."""

    odometry: float = 1.0  # times SIGMAS
    detections: float = 1.0  # times the standard deviations stated
    bias_rad_per_m: float = 0.0
    tells_covariances: bool = False  # with the detections, those that are stated


def write_drive(path: Path, noise: Noise, num_keyframes: int = 60, seed: int = 0) -> Path:
    """The bag, with the truth."""
    random = np.random.default_rng(seed)
    posts = random.uniform([-8.0, -4.0], [8.0, 12.0], size=(NUM_POSTS, 2))
    true, odometry = np.zeros(3), np.zeros(3)
    with BagWriter(path) as writer:
        for k in range(num_keyframes):
            stamp = START + k * PERIOD
            if k:
                odometry = se2.compose(odometry, STEP)
                error = noise.odometry * SIGMAS * random.normal(size=3)
                turned = STEP + noise.bias_rad_per_m * np.array([0.0, 0.0, STEP[0]])
                true = se2.compose(se2.compose(true, turned), se2.exp(error))
            writer.write(topics.ODOMETRY, odometry_message(stamp, odometry, "odom"), stamp)
            writer.write(topics.GROUND_TRUTH_ODOMETRY, odometry_message(stamp, true, "map"), stamp)
            polar, seen = _detected(true, posts, noise, random)
            names = tuple("" if n < 0 else f"post {n}" for n in seen)
            writer.write(topics.GROUND_TRUTH_ASSOCIATIONS, GroundTruthAssociations(stamp, names), stamp)
            writer.write(topics.DETECTIONS, _detections(stamp, polar, noise), stamp)
        ids = tuple(f"post {n}" for n in range(len(posts)))
        poses = pose_vector_from_planar(np.column_stack([posts, np.zeros(len(posts))]))
        writer.write(topics.GROUND_TRUTH_OBJECTS, GroundTruthObjects(START, ids, ("post",) * len(ids), poses), START)
    return path


def _detected(pose: Array, posts: Array, noise: Noise, random: np.random.Generator) -> tuple[Array, list[int]]:
    """(D, 2) ranges and bearings, and which post each is of, -1 for a false alarm."""
    offset = posts - pose[:2]
    polar = np.stack([np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0]) - pose[2]], axis=1)
    polar[:, 1] = (polar[:, 1] + np.pi) % (2.0 * np.pi) - np.pi
    inside = (polar[:, 0] > 0.8) & (polar[:, 0] < REACH_M - 0.5) & (np.abs(polar[:, 1]) < HALF_ANGLE - 0.1)
    seen = np.flatnonzero(inside & (random.random(len(posts)) < 0.9))
    polar = polar[seen] + noise.detections * random.normal(size=(len(seen), 2)) * [SIGMA_RANGE, SIGMA_BEARING]
    alarms = random.poisson(0.1)
    false = random.uniform([1.0, -0.9], [REACH_M - 0.5, 0.9], size=(alarms, 2))
    return np.concatenate([polar, false]), [*seen.tolist(), *([-1] * alarms)]


def _detections(stamp: int, polar: Array, noise: Noise) -> Detections:
    count = len(polar)
    told = np.diag([SIGMA_RANGE**2, SIGMA_BEARING**2, 1.0])
    return Detections(
        stamp_ns=stamp,
        frame_id="base_link",
        boxes=np.full((count, 4), np.nan),
        labels=("post",) * count,
        scores=np.ones(count),
        track_ids=("",) * count,
        ranges_m=polar[:, 0],
        bearings_rad=polar[:, 1],
        elevations_rad=np.full(count, np.nan),
        **({"place_covariances": np.tile(told, (count, 1, 1))} if noise.tells_covariances else {}),
    )
