"""The engine in space: what it says in the plane is what the planar engine says."""

import json
from pathlib import Path

import numpy as np
import pytest
from worlds.exact.spatial_fixtures import NOTHING_LEFT_OUT, history_weights, run_spatial, spatial
from worlds.scenes.bodies import IN_PLANE, PINNED, full

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se2, se3, so3
from semantic_slam.geometry.pose import pose_vector_from_planar

FIXTURE = json.loads((Path(__file__).parents[2] / "fixtures" / "ch4_se3_N3_k2_n2.json").read_text(encoding="utf-8"))
POINTS = np.array([[2.0, 1.0], [2.3, -0.6], [3.4, 0.4]])
START = np.array([0.1, -0.1, 0.2])
START_VARIANCES = np.array([0.2, 0.2, 0.05])
STEP, STEP_VARIANCES = np.array([0.5, 0.05, 0.15]), np.array([0.0025, 0.0025, 0.0009])
RANGE_SIGMA, BEARING_SIGMA = 0.35, 0.3
SEEN = ((0, 1), (2, 0), (1, 2))


def detections(random: np.random.Generator, names: bool) -> list[list[tuple[float, float, str]]]:
    """Range, bearing and name of what a robot sees that drives as odometry has it."""
    x, frames = se2.compose(START, np.array([0.2, 0.1, 0.05])), []
    for seen in SEEN:
        x = se2.compose(x, STEP)
        body = [se2.between(x, np.append(POINTS[n], 0.0))[:2] for n in seen]
        polar = [(np.hypot(*p), np.arctan2(p[1], p[0])) for p in body]
        noise = random.normal(scale=[RANGE_SIGMA, BEARING_SIGMA], size=(len(seen), 2))
        frames.append(
            [(r + a, b + e, f"p{n}" if names else "") for n, (r, b), (a, e) in zip(seen, polar, noise, strict=True)]
        )
    return frames


def planar_run(frames: list, association: str, method: str) -> tuple[Engine, HybridBelief]:
    weights = {**NOTHING_LEFT_OUT["weights"], "method": method}
    configuration = Configuration.of(
        observation="points",
        semantic_model={"kind": "none"},
        association=association,
        **{**NOTHING_LEFT_OUT, "weights": weights},
    )
    prior = MapPrior(tuple(ObjectPrior.planar(n, *p, sigma_m=0.22, sigma_rad=0.1) for n, p in enumerate(POINTS)))
    engine = Engine(
        configuration,
        prior if association == "enumerated" else None,
        initial_pose=START,
        initial_covariance=np.diag(START_VARIANCES),
    )
    for k, frame in enumerate(frames):
        seen = [
            Detection(range_m=r, bearing_rad=b, covariance=np.diag([RANGE_SIGMA, BEARING_SIGMA]) ** 2, track_id=name)
            for r, b, name in frame
        ]
        belief = engine.process(Keyframe.planar(k, motion=STEP, motion_sigmas=np.sqrt(STEP_VARIANCES), detections=seen))
    return engine, belief


def level_run(frames: list, association: str, method: str) -> tuple[Engine, HybridBelief]:
    """In space, with height, roll and pitch known."""
    prior = MapPrior(tuple(level_point(n, p) for n, p in enumerate(POINTS)))
    engine = Engine(
        spatial(association=association, weights={**NOTHING_LEFT_OUT["weights"], "method": method}),
        prior if association == "enumerated" else None,
        initial_pose=pose_vector_from_planar(START),
        initial_covariance=full(START_VARIANCES),
    )
    for k, frame in enumerate(frames):
        seen = [
            Detection.along(
                [np.cos(b), np.sin(b), 0.0],
                r,
                sigma_range_m=RANGE_SIGMA,
                ray_covariance=BEARING_SIGMA**2 * np.eye(3),
                track_id=name,
            )
            for r, b, name in frame
        ]
        motion = {"motion": pose_vector_from_planar(STEP), "motion_covariance": full(STEP_VARIANCES)}
        belief = engine.process(Keyframe.spatial(k, detections=seen, **motion))
    return engine, belief


def level_point(number: int, place: np.ndarray) -> ObjectPrior:
    return ObjectPrior(
        object_id=number,
        name=f"object_{number}",
        pose=np.array([*place, 0.0, 0.0, 0.0, 0.0, 1.0]),
        covariance=np.diag([0.22**2, 0.22**2, PINNED, 0.0, 0.0, 0.0]),
        class_probabilities={},
    )


def test_a_spatial_run_that_stays_in_the_plane_is_the_planar_run() -> None:
    """Weights, evidence of one history against another, poses and covariances to 1e-6.

    All rays are level and all means lie in the plane, about which everything is symmetric: at every mode what is in the
    plane and what is out of it do not depend on each other. The latter has variances v = 1e-9: each density becomes the
    planar one times a constant that is that of every history but for v / (range sigma)^2.
    """
    frames = detections(np.random.default_rng(4), names=False)
    (plane, flat), (space, level) = (run(frames, "enumerated", "laplace") for run in (planar_run, level_run))
    expected, found = history_weights(plane), history_weights(space)
    assert sorted(expected) == sorted(found) and len(found) == 6**3
    assert max(abs(found[beta] - weight) for beta, weight in expected.items()) < 1e-6
    assert sorted(expected.values())[-4] > 0.1, "an association alone would be no test"
    heavy = np.flatnonzero(flat.log_weights > np.log(1e-4))  # what hardly weighs is updated to its thresholds alone
    order = [list(space.live).index(list(plane.live)[row]) for row in heavy]
    np.testing.assert_allclose(level.poses[order], flat.poses[heavy], atol=1e-6)
    spreads = level.pose_covariances[order], flat.pose_covariances[heavy]
    np.testing.assert_allclose(*(own[:, IN_PLANE][:, :, IN_PLANE] for own in spreads), atol=1e-6)
    np.testing.assert_allclose(level.object_poses[:, :3], flat.object_poses[:, :3], atol=1e-6)
    np.testing.assert_allclose(level.object_covariances[:, :2, :2], flat.object_covariances[:, :2, :2], atol=1e-6)
    assert (flat.state_space, flat.planar) == ("planar", True)
    assert (level.state_space, level.planar) == ("spatial", False)


def test_named_points_are_mapped_alike_in_the_plane_and_in_space() -> None:
    frames = detections(np.random.default_rng(5), names=True)
    (_, flat), (_, level) = (run(frames, "given", "laplace") for run in (planar_run, level_run))
    np.testing.assert_allclose(level.poses, flat.poses, atol=1e-6)
    assert level.object_names == flat.object_names == ("p0", "p1", "p2")


def tumbling(random: np.random.Generator, count: int) -> list[np.ndarray]:
    """Motions (7,) of a hand-held camera."""
    return [se3.exp(random.normal(scale=[0.15, 0.15, 0.15, 0.2, 0.2, 0.2])) for _ in range(count)]


def test_a_hand_held_camera_maps_named_points_through_its_extrinsics() -> None:
    """Without noise all is found where it is, seen by a camera that stands beside the body and is turned against it."""
    random = np.random.default_rng(2)
    T_body_camera = se3.exp(np.array([1.2, -1.2, 1.2, 0.1, -0.2, 0.3]))
    points = {f"p{n}": place for n, place in enumerate(random.uniform(-3.0, 3.0, (5, 3)))}
    engine = Engine(spatial(association="given", initial_pose={"mean": [0.0] * 6, "sigma": [1e-4] * 6}))
    x = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    for k, motion in enumerate(tumbling(random, 6)):
        x = se3.compose(x, motion)
        camera = se3.compose(x, T_body_camera)
        seen = []
        for name, place in points.items():
            body = so3.rotated(so3.inverse(camera[3:]), place - camera[:3])
            distance = float(np.linalg.norm(body))
            noise = {"sigma_range_m": 0.05, "ray_covariance": np.diag([1e-4, 2e-4, 4e-4])}
            seen.append(Detection.along(body, distance, T_body_sensor=T_body_camera, track_id=name, **noise))
        belief = engine.process(Keyframe.spatial(k, motion=motion, detections=seen))
    np.testing.assert_allclose(belief.poses[0, :3], x[:3], atol=1e-6)
    np.testing.assert_allclose(belief.object_poses[:, :3], list(points.values()), atol=1e-6)
    (sigma, *_) = np.sqrt(np.diagonal(belief.object_covariances[:, :3, :3], axis1=1, axis2=2)).max(axis=1)
    assert 1e-3 < sigma < 0.1


def test_the_number_of_backends_changes_nothing_in_space() -> None:
    one, two = (run_spatial(FIXTURE["input"], backends, weights={"importance_samples": 256}) for backends in (1, 2))
    assert list(one[0].live) == list(two[0].live)
    np.testing.assert_array_equal(one[1].log_weights, two[1].log_weights)
    np.testing.assert_array_equal(one[1].poses, two[1].poses)


@pytest.mark.parametrize("share", [0.0, 0.005])
def test_a_run_with_names_may_begin_with_nothing_in_sight(share: float) -> None:
    start = {"mean": [0.0] * 6, "sigma": [0.1] * 6}
    engine = Engine(
        spatial(association="given", initial_pose=start, closed_world={"wrong_identity_share": share}),
    )
    assert not engine.process(Keyframe.spatial(0)).object_names
    seen = Detection.along([1.0, 0.0, 0.0], 2.0, track_id="cup")
    (cup,) = engine.process(Keyframe.spatial(1, detections=[seen])).objects
    np.testing.assert_allclose(cup.position, [2.0, 0.0, 0.0], atol=1e-6)
