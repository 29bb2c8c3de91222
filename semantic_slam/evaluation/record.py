"""A recorded run: beliefs, inputs and ground truth."""

import json
from dataclasses import dataclass, field
from typing import Any

from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.relocation.carried_spans import Spans
from semantic_slam.messages.ground_truth import GroundTruthObjects
from semantic_slam.perception.measurement import SemanticMeasurements


@dataclass(frozen=True)
class GroundTruth:
    """Ground truth of a bag, as far as it has any."""

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
    dropped: dict[str, int] = field(default_factory=dict)  # unused inputs and dropped hypotheses, by reason
    fault: str = ""  # why the bag could not be read to its end
    carried: Spans = ()  # keyframes in which the robot was taken for carried elsewhere

    @property
    def begun_late(self) -> str:
        """Why its run cannot be inferred again: the recorder began during it; "" for a run recorded from its start.

        A single belief is the newest one of a running manager, which has all keyframes before.
        """
        first = self.beliefs[0].keyframe
        if not first or len(self.beliefs) == 1:
            return ""
        return f"the bag begins with keyframe {first}, and the run cannot be inferred again without what came before"


def json_object(text: str) -> dict[str, Any]:
    """Parse ``text`` as a JSON object; empty where it is none."""
    try:
        value = json.loads(text)
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}
