"""A recorded run: what was believed, from what, and what was true."""

import json
from dataclasses import dataclass, field
from typing import Any

from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.messages.ground_truth import GroundTruthObjects
from semantic_slam.perception.measurement import SemanticMeasurements


@dataclass(frozen=True)
class GroundTruth:
    """Whatever part of the truth a bag holds."""

    trajectory: Trajectory  # T_map_body; empty when not known
    objects: GroundTruthObjects | None
    associations: dict[int, tuple[str, ...]]  # stamp of the detections -> true object id per detection, "" clutter


@dataclass(frozen=True)
class Record:
    """K beliefs of one run in order, with their inputs."""

    run: RunConfiguration
    beliefs: tuple[HybridBelief, ...]  # (K,)
    odometry: Trajectory  # T_odom_body
    measurements: dict[int, SemanticMeasurements]  # by stamp_ns
    truth: GroundTruth | None
    dropped: dict[str, int] = field(default_factory=dict)  # inputs not used and hypotheses given up, by reason
    fault: str = ""  # why the bag could not be read to its end


def json_object(text: str) -> dict[str, Any]:
    """The object that ``text`` holds; empty where it holds none."""
    try:
        value = json.loads(text)
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}
