"""A drive of four keyframes past two objects, as messages without pictures, with its map: small enough to run often."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.bag.writer import BagWriter
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.standard import NANOSECONDS, OdometryEstimate, PoseEstimate
from semantic_slam.perception.frame import Detections
from semantic_slam_lab.simulation.detectors.told_places import told_places

START_NS = 1_700_000_000 * NANOSECONDS
PERIOD_NS = NANOSECONDS // 2
NUM_FRAMES = 4
SPEED_M = 0.1  # per frame, along x
OBJECTS = np.array([[3.0, 0.5], [3.5, -0.6]])
PLAIN: dict[str, Any] = {"semantic_model": {"kind": "none"}}


@dataclass
class Item:
    """One message on its way into a bag."""

    topic: str
    message: Any
    stamp_ns: int


def items() -> list[Item]:
    """Initial pose, odometry and detections, in the order of their stamps."""
    found = [Item(topics.INITIAL_POSE, to_message(_initial_pose()), START_NS)]
    for k in range(NUM_FRAMES + 1):
        stamp_ns = START_NS + k * PERIOD_NS
        found.append(Item(topics.ODOMETRY, to_message(_odometry(stamp_ns, SPEED_M * k)), stamp_ns))
        if k < NUM_FRAMES:
            found.append(Item(topics.DETECTIONS, to_message(_detections(stamp_ns, SPEED_M * k)), stamp_ns))
    return found


def write(path: Path, messages: list[Item], prior: MapPrior | None) -> Path:
    """The messages as a bag, with the map beside them."""
    with BagWriter(path) as writer:
        for item in messages:
            writer.write(item.topic, item.message, item.stamp_ns)
    if prior is not None:
        (path / "objects.json").write_text(prior.to_json(), encoding="utf-8")
    return path


def map_prior() -> MapPrior:
    """The two objects."""
    return MapPrior(
        tuple(
            ObjectPrior.planar(n + 1, float(x), float(y), sigma_m=0.1, sigma_rad=0.1)
            for n, (x, y) in enumerate(OBJECTS)
        )
    )


def _initial_pose() -> PoseEstimate:
    covariance = np.diag([0.01, 0.01, 0.0, 0.0, 0.0, 0.01])
    return PoseEstimate(START_NS, "map", np.array([0.0, 0, 0, 0, 0, 0, 1]), covariance)


def _odometry(stamp_ns: int, x: float) -> OdometryEstimate:
    return OdometryEstimate(stamp_ns, "odom", "base_link", np.array([x, 0.0, 0, 0, 0, 0, 1]), np.zeros((6, 6)))


def _detections(stamp_ns: int, x: float) -> Detections:
    ahead = OBJECTS - [x, 0.0]
    return told_places(stamp_ns, np.hypot(*ahead.T), np.arctan2(ahead[:, 1], ahead[:, 0]), (0.01, 0.001))
