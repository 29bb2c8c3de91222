"""A robot that stands at the origin and is given frame after frame of detections."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior

STILL = (1e-5, 1e-5, 1e-5)
"""Standard deviations of its motions."""


def beliefs_at_rest(
    frames: Sequence[Sequence[Detection]],
    configuration: Configuration,
    known: MapPrior,
    backends: int = 1,
    sigma: float = 1e-5,
) -> list[HybridBelief]:
    """Of a robot that knows where it stands to ``sigma``."""
    spread = np.diag([sigma, sigma, 1e-5]) ** 2
    engine = Engine(configuration, known, initial_pose=np.zeros(3), initial_covariance=spread, backends=backends)
    return [engine.process(Keyframe.planar(k, detections=own, motion_sigmas=STILL)) for k, own in enumerate(frames)]
