"""A heading that nobody measures changes nothing: where objects are, how sure, and which of them was seen."""

from typing import Any

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe, MapPrior, ObjectPrior

OBJECTS = np.array([[3.0, 0.5], [3.2, -0.5], [3.9, 0.1]])
SIGMA_M, START_SIGMAS = 0.3, np.array([0.3, 0.3, 0.1])
STEP = (0.3, 0.1, 0.2)
RANGE_SIGMA_M, BEARING_SIGMA_RAD = 0.1, 0.05


def detections(pose: np.ndarray, random: np.random.Generator, names: bool) -> list[Detection]:
    """Of the first two objects, from a pose x, y, yaw."""
    found = []
    for number, away in enumerate(OBJECTS[:2] - pose[:2]):
        distance, bearing = np.hypot(*away), np.arctan2(away[1], away[0]) - pose[2]
        errors = random.normal(size=2) * [RANGE_SIGMA_M, BEARING_SIGMA_RAD]
        found.append(
            Detection(
                range_m=distance + errors[0],
                bearing_rad=bearing + errors[1],
                covariance=np.diag([RANGE_SIGMA_M**2, BEARING_SIGMA_RAD**2]),
                track_id=str(number) if names else "",
            )
        )
    return found


def believed(prior: MapPrior | None, seed: int, method: str, **settings: Any) -> list[HybridBelief]:
    """Beliefs of three keyframes."""
    run = Configuration.of(
        semantic_model={"kind": "none"},
        closed_world={"clutter_per_frame": 0.0, "wrong_identity_share": 0.0},
        pruning={"ratio": 1e12, "max_hypotheses": 1000},
        weights={"method": method},
        **settings,
    )
    random, pose = np.random.default_rng(seed), START_SIGMAS * np.random.default_rng(seed + 100).normal(size=3)
    engine = Engine(run, prior, initial_pose=np.zeros(3), initial_covariance=np.diag(START_SIGMAS**2))
    beliefs = []
    for k in range(3):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        pose = pose + np.array([c * STEP[0] - s * STEP[1], s * STEP[0] + c * STEP[1], STEP[2]]) if k else pose
        seen = detections(pose, random, names=settings["association"] == "given")
        motion = STEP if k else (0.0, 0.0, 0.0)
        beliefs.append(engine.process(Keyframe.planar(k, motion=motion, motion_sigmas=(0.02,) * 3, detections=seen)))
    return beliefs


def around(sigma_rad: float) -> MapPrior:
    places = OBJECTS + SIGMA_M * np.random.default_rng(7).normal(size=OBJECTS.shape)
    return MapPrior(
        tuple(
            ObjectPrior.planar(n, *place, 0.3 * n, sigma_m=SIGMA_M, sigma_rad=sigma_rad, name=f"t{n}")
            for n, place in enumerate(places)
        )
    )


def assert_equal_but_for_headings(one: HybridBelief, other: HybridBelief) -> None:
    """Evidence and weights to the last digits; moments as nearly as samples have them."""
    assert one.log_evidence == pytest.approx(other.log_evidence, abs=1e-6)
    np.testing.assert_allclose(one.log_weights[:2], other.log_weights[:2], atol=1e-6)
    np.testing.assert_array_equal(one.associations[:2], other.associations[:2])
    sigmas = np.sqrt(np.diagonal(one.object_covariances, axis1=1, axis2=2))[:, :2]
    np.testing.assert_allclose(one.object_poses[:, :2], other.object_poses[:, :2], atol=1e-3 * SIGMA_M)
    others = np.sqrt(np.diagonal(other.object_covariances, axis1=1, axis2=2))[:, :2]
    np.testing.assert_allclose(sigmas, others, rtol=1e-3)
    np.testing.assert_allclose(one.poses[0, :2], other.poses[0, :2], atol=1e-3 * SIGMA_M)


@pytest.mark.parametrize(("method", "seed"), [("laplace", 1), ("importance", 3), ("sampled", 3)])
def test_headings_of_the_map(method: str, seed: int) -> None:
    known, unknown = (believed(around(sigma_rad), seed, method, association="enumerated") for sigma_rad in (0.01, 3.0))
    for pair in zip(known, unknown, strict=True):
        assert_equal_but_for_headings(*pair)


@pytest.mark.parametrize(("method", "seed"), [("laplace", 1), ("importance", 3)])
def test_headings_of_new_objects(method: str, seed: int) -> None:
    known, unknown = (
        believed(None, seed, method, association="given", new_objects={"sigma_heading_rad": sigma_rad})
        for sigma_rad in (0.01, 3.1)
    )
    for pair in zip(known, unknown, strict=True):
        assert_equal_but_for_headings(*pair)
