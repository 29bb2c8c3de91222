"""Fixtures in space: a robot in SE(3) among points in R^3, through the face of the package."""

from typing import Any

import numpy as np

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se3
from semantic_slam.geometry.moments import matched_moments

NOTHING_LEFT_OUT = {
    "weights": {
        "gate": np.inf,
        "max_candidates": 10**9,
        "importance_samples": 4096,
        "importance_gate": np.inf,
        "gaussian_share": 0.9999,
        "max_history": 100,
    },
    "pruning": {"ratio": 1e300, "max_hypotheses": 10**9},
    "closed_world": {"clutter_per_frame": 0.0, "wrong_identity_share": 0.0},
}


def spatial(**values: Any) -> Configuration:
    """Of a run in space, of geometry alone."""
    return Configuration.of(
        state_space="spatial", observation="points", semantic_model={"kind": "none"}, **{**NOTHING_LEFT_OUT, **values}
    )


def run_spatial(given: dict, backends: int = 1, **values: Any) -> tuple[Engine, HybridBelief]:
    """The ``input`` of a fixture, to the end."""
    start = np.array(given["x0"])
    engine = Engine(
        spatial(**values),
        MapPrior(tuple(_object(n, place, given["So"]) for n, place in enumerate(given["objects"]))),
        initial_pose=start,
        initial_covariance=se3.covariance_along_parent(start, np.diag(given["Sp"])),
        backends=backends,
    )
    for k, (motion, frame) in enumerate(zip(given["u"], given["Z"], strict=True)):
        covariance = np.diag(np.array(given["Sw"])[se3.TO_MESSAGE])
        seen = [_detection(item, given["Sv"]) for item in frame]
        belief = engine.process(Keyframe.spatial(k, motion=motion, motion_covariance=covariance, detections=seen))
    return engine, belief


def _object(number: int, place: list[float], variances: list[float]) -> ObjectPrior:
    return ObjectPrior(
        object_id=number,
        name=str(number),
        pose=np.array([*place, 0.0, 0.0, 0.0, 1.0]),
        covariance=np.diag([*variances, 0.0, 0.0, 0.0]),
        class_probabilities={},
    )


def _detection(item: dict, variances: list[float]) -> Detection:
    return Detection.along(
        item["ray"], item["range"], sigma_range_m=np.sqrt(variances[0]), ray_covariance=variances[1] * np.eye(3)
    )


def history_weights(engine: Engine) -> dict[tuple, float]:
    """Weight of each association history, its modes together."""
    found: dict[tuple, float] = {}
    for live in engine.live.values():
        beta = tuple(step.association for step in live.lineage)
        found[beta] = found.get(beta, 0.0) + float(np.exp(live.log_weight))
    return found


def spatial_deviations(data: dict, method: str = "importance") -> dict[str, float]:
    """How far the engine is off: weights and log evidence as they are, means in standard deviations."""
    weights = {**NOTHING_LEFT_OUT["weights"], "method": method}
    engine, belief = run_spatial(data["input"], weights=weights)
    expected, found = data["expected"], history_weights(engine)
    pose, spread = matched_moments(np.exp(belief.log_weights), belief.poses, belief.pose_covariances)
    off = se3.log(se3.between(np.array(expected["xk_mean"]), pose))
    sigmas = np.sqrt(np.diagonal(se3.covariance_at_pose(pose, spread)))
    places = belief.object_poses[:, :3] - np.array(expected["object_means"])
    object_sigmas = np.sqrt(np.diagonal(belief.object_covariances[:, :3, :3], axis1=1, axis2=2))
    rows = {tuple(map(tuple, row["beta"])): row["weight"] for row in expected["hypotheses"]}
    return {
        "weight": max(abs(found.get(beta, 0.0) - weight) for beta, weight in rows.items()),
        "log_evidence": abs(engine.log_evidence - expected["log_evidence"]),
        "xk_mean": float(np.abs(off / sigmas).max()),
        "object_means": float(np.abs(places / object_sigmas).max()),
        "place_sigma": float(
            np.abs(np.sqrt(np.diagonal(spread)[:3] / np.diagonal(expected["xk_place_cov"])) - 1.0).max()
        ),
    }
