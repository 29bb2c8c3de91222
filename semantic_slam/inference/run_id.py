"""Ids of runs: digests of all inputs that determine them."""

import json
from collections.abc import Sequence

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.states.identity import digest


def run_id_of(settings: str, prior: str, pose: Array, covariance: Array, class_names: Sequence[str]) -> str:
    """Digest of all that determines a run besides its keyframes."""
    return digest(settings, prior, json.dumps(pose.tolist()), json.dumps(covariance.tolist()), *class_names)


def is_id_of_its_contents(run: RunConfiguration) -> bool:
    """Whether an announced run's id, without the session suffix, matches the digest of its contents."""
    told = (run.configuration, run.map_prior, run.initial_pose, run.initial_covariance, run.class_names)
    return run.run_id.partition(".")[0] == run_id_of(*told)
