"""Fixtures in space: a robot in SE(3) among points in R^3, through the face of the package."""

from typing import Any

import numpy as np

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.moments import matched_moments

NAMES = ("class_1", "class_2")
NOTHING_LEFT_OUT = {
    "weights": {
        "gate": np.inf,
        "max_candidates": 10**9,
        "max_associations": 0,
        "importance_samples": 4096,
        "importance_gate": np.inf,
        "gaussian_share": 0.9999,
        "max_history": 100,
    },
    "pruning": {"ratio": 1e300, "max_hypotheses": 10**9},
    "closed_world": {"clutter_per_frame": 0.0, "wrong_identity_share": 0.0},
}


def spatial(**values: Any) -> Configuration:
    """Of a run in space, of points and geometry alone unless ``values`` say otherwise."""
    points = {"observation": "points", "semantic_model": {"kind": "none"}}
    return Configuration.of(state_space="spatial", **{**points, **NOTHING_LEFT_OUT, **values})


def run_spatial(given: dict, backends: int = 1, **values: Any) -> tuple[Engine, HybridBelief]:
    """The ``input`` of a fixture, to the end."""
    start = np.array(given["x0"])
    scored = _scored(given) if "Ksem" in given else {}
    engine = Engine(
        spatial(**{**scored, **values}),
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


def _scored(given: dict) -> dict[str, Any]:
    """Settings of a run among objects with an attitude and two classes."""
    kind = {"kind": "parametric", "alpha": given["alpha"], "concentration": given["Ksem"], "class_names": list(NAMES)}
    return {
        "observation": "range_bearing",
        "semantic_model": {**kind, "outlier_share": 0.0},
        "new_objects": {"sigma_tilt_rad": 1e-6},  # the map has it
    }


def _object(number: int, place: list[float], variances: list[float]) -> ObjectPrior:
    if len(place) == 7:
        pose = np.array(place)
        covariance = se3.covariance_along_parent(pose, np.diag(variances))
        return ObjectPrior(object_id=number, name=str(number), pose=pose, covariance=covariance, class_probabilities={})
    return ObjectPrior(
        object_id=number,
        name=str(number),
        pose=np.array([*place, 0.0, 0.0, 0.0, 1.0]),
        covariance=np.diag([*variances, 0.0, 0.0, 0.0]),
        class_probabilities={},
    )


def _detection(item: dict, variances: list[float]) -> Detection:
    return Detection.along(
        item["ray"],
        item["range"],
        sigma_range_m=np.sqrt(variances[0]),
        ray_covariance=variances[1] * np.eye(3),
        class_scores=dict(zip(NAMES, item["sem"], strict=True)) if "sem" in item else {},
    )


def class_weights(engine: Engine) -> dict[tuple, float]:
    """Weight of each association history with the classes of all objects, each of which has been seen."""
    found: dict[tuple, float] = {}
    for live in engine.live.values():
        classes: dict[int, int] = {}
        for step in live.lineage:
            classes |= dict(zip(step.association, step.class_assignment, strict=True))
        key = tuple(step.association for step in live.lineage), tuple(classes[n] for n in sorted(classes))
        found[key] = found.get(key, 0.0) + float(np.exp(live.log_weight))
    return found


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
    expected, scored = data["expected"], "Ksem" in data["input"]
    found = class_weights(engine) if scored else history_weights(engine)
    pose, spread = matched_moments(np.exp(belief.log_weights), belief.poses, belief.pose_covariances)
    off = se3.log(se3.between(np.array(expected["xk_mean"]), pose))
    sigmas = np.sqrt(np.diagonal(se3.covariance_at_pose(pose, spread)))
    places = belief.object_poses[:, :3] - np.array(expected["object_means"])
    object_sigmas = np.sqrt(np.diagonal(belief.object_covariances[:, :3, :3], axis1=1, axis2=2))
    rows = {_explanation(row): row["weight"] for row in expected["hypotheses"]}
    turns = {"object_turns": _turn_deviation(belief, expected["object_turns"])} if scored else {}
    return {
        **turns,
        "weight": max(abs(found.get(beta, 0.0) - weight) for beta, weight in rows.items()),
        "log_evidence": abs(engine.log_evidence - expected["log_evidence"]),
        "xk_mean": float(np.abs(off / sigmas).max()),
        "object_means": float(np.abs(places / object_sigmas).max()),
        "place_sigma": float(
            np.abs(np.sqrt(np.diagonal(spread)[:3] / np.diagonal(expected["xk_place_cov"])) - 1.0).max()
        ),
    }


def _turn_deviation(belief: HybridBelief, expected: list[list[float]]) -> float:
    """Largest deviation of an object's mean attitude about the vertical, in standard deviations."""
    off = so3.log(so3.product(so3.inverse(np.array(expected)), belief.object_poses[:, 3:]))
    return float(np.abs(off[:, 2] / np.sqrt(belief.object_covariances[:, 5, 5])).max())


def _explanation(row: dict) -> tuple:
    """A hypothesis of a fixture as the engine's weights are keyed."""
    beta = tuple(map(tuple, row["beta"]))
    return (beta, tuple(row["C"])) if "C" in row else beta
