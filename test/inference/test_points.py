"""A planar robot among points, end to end: spaces of different sizes against samples of the prior and closed forms."""

from dataclasses import replace
from functools import cache
from itertools import permutations, product

import numpy as np
import pytest
from worlds.scenes.points import (
    BodyPointObservation,
    PointOutcome,
    PointWorld,
    body_point,
    drive,
    range_bearing,
    run_points,
)

from semantic_slam.configuration import WeightsConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.moments import matched_moments
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.association.map_gate import FEW_OBJECTS
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.point_observation import PointObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.semantics.track_samples import StateSamples
from semantic_slam.inference.smoothing.solver.elimination import MOST_JOINT
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.problem import Problem
from semantic_slam.inference.world.roots import closed_root

DRAWS, CHUNK = 1 << 20, 1 << 16
POINTS = np.array([[2.0, 1.0], [2.3, -0.6], [3.4, 0.4]])
SEEN = ((0, 1), (2, 0))
"""Which point each detection is truly of."""
PAIRS = list(permutations(range(len(POINTS)), 2))
"""Every association of two detections to different points."""


# Range and bearing: against importance sampling from the prior.


@cache
def curved_world() -> PointWorld:
    """Wide priors and coarse measurements, so that many associations keep some weight and prior samples suffice."""
    random = np.random.default_rng(4)
    noise = np.diag([0.25, 0.12]) ** 2
    motions = [Motion(np.array([0.5, 0.0, 0.15]), np.diag([0.05, 0.05, 0.03]) ** 2) for _ in SEEN]
    start = GaussianPrior(np.array([0.1, -0.1, 0.2]), np.diag([0.3, 0.3, 0.1]) ** 2)
    truth = se2.compose(start.mean, se2.exp(random.multivariate_normal(np.zeros(3), start.covariance)))
    spread = np.array([[0.06, 0.01], [0.01, 0.04]])
    places = POINTS + random.multivariate_normal(np.zeros(2), spread, len(POINTS))
    frames = []
    for x, seen in zip(drive(truth, motions, random), SEEN, strict=True):
        noisy = [body_point(x, places[n]) for n in seen]
        polar = [np.array([np.hypot(*p), np.arctan2(p[1], p[0])]) + random.normal(size=2) * [0.25, 0.12] for p in noisy]
        frames.append([range_bearing(r * np.array([np.cos(b), np.sin(b)]), noise) for r, b in polar])
    return PointWorld(start, POINTS, spread, motions, frames, PointObservation())


@cache
def curved_outcome() -> PointOutcome:
    return run_points(curved_world())


@cache
def sampled_posterior() -> tuple[dict, np.ndarray, np.ndarray, float, float]:
    """Weights of all histories, mean and covariance of the newest robot, log evidence, effective number of samples.

    Prior samples of all states, weighed by the density of every detection under every association, written out here.
    The mean is that of position and direction, the covariance along map's axes.
    """
    world, random = curved_world(), np.random.default_rng(7)
    histories = list(product(PAIRS, repeat=len(world.frames)))
    totals, moments, squares = np.zeros(len(histories)), [], 0.0
    for _ in range(DRAWS // CHUNK):
        x = _moved(np.tile(world.start.mean, (CHUNK, 1)), _normals(random, world.start.covariance))
        o = world.points + random.multivariate_normal(np.zeros(2), world.spread, (CHUNK, len(POINTS)))
        likelihood = np.ones((CHUNK, 1))
        for motion, frame in zip(world.motions, world.frames, strict=True):
            x = _moved(_moved(x, np.zeros((CHUNK, 3)), motion.control), _normals(random, motion.covariance))
            density = np.stack([_density(item, x, o) for item in frame], axis=1)  # (draws, D, N)
            own = np.stack(
                [density[:, 0, a] * density[:, 1, b] for a, b in permutations(range(len(POINTS)), 2)], axis=1
            )
            likelihood = (likelihood[:, :, None] * own[:, None]).reshape(CHUNK, -1)
        totals += likelihood.sum(axis=0)
        weight = likelihood.sum(axis=1)
        squares += float((weight**2).sum())
        features = np.column_stack(
            [x[:, :2], np.cos(x[:, 2]), np.sin(x[:, 2]), x[:, 0] ** 2, x[:, 1] ** 2, x[:, 0] * x[:, 1]]
        )
        moments.append(weight @ features)
    total = totals.sum()
    mx, my, c, s, xx, yy, xy = np.sum(moments, axis=0) / total
    covariance = np.array([[xx - mx * mx, xy - mx * my], [xy - mx * my, yy - my * my]])
    weights = dict(zip(histories, totals / total, strict=True))
    return weights, np.array([mx, my, np.arctan2(s, c)]), covariance, np.log(total / DRAWS), total**2 / squares


def _normals(random: np.random.Generator, covariance: np.ndarray) -> np.ndarray:
    return random.standard_normal((CHUNK, 3)) * np.sqrt(np.diag(covariance))


def _moved(x: np.ndarray, tangent: np.ndarray, control: np.ndarray | None = None) -> np.ndarray:
    """x Exp(tangent), or x with a control."""
    theta = tangent[:, 2] + 1e-12
    a, b = np.sin(theta) / theta, (1.0 - np.cos(theta)) / theta
    dx, dy, turn = a * tangent[:, 0] - b * tangent[:, 1], b * tangent[:, 0] + a * tangent[:, 1], tangent[:, 2]
    if control is not None:
        dx, dy, turn = control
    c, s = np.cos(x[:, 2]), np.sin(x[:, 2])
    return np.column_stack([x[:, 0] + c * dx - s * dy, x[:, 1] + s * dx + c * dy, x[:, 2] + turn])


def _density(item, x: np.ndarray, o: np.ndarray) -> np.ndarray:
    """(draws, N) of one detection for each point; its noise has no correlation."""
    away = o - x[:, None, :2]
    distance = np.hypot(away[..., 0], away[..., 1])
    bearing = np.arctan2(away[..., 1], away[..., 0]) - x[:, 2:]
    turn = (bearing - item.bearing_rad + np.pi) % (2.0 * np.pi) - np.pi
    by_range, by_bearing = np.sqrt(np.diag(item.covariance))
    exponent = ((distance - item.range_m) / by_range) ** 2 + (turn / by_bearing) ** 2
    return np.exp(-0.5 * exponent) / (2.0 * np.pi * by_range * by_bearing)


@pytest.mark.slow
def test_weights_are_those_of_the_prior_s_samples() -> None:
    expected, _, _, log_evidence, effective = sampled_posterior()
    assert effective > 10_000
    outcome = curved_outcome()
    assert outcome.log_evidence == pytest.approx(log_evidence, abs=0.03)
    assert sorted(expected.values())[-2] > 0.1, "an association alone would be no test"
    for beta, weight in expected.items():
        assert outcome.weights.get(beta, 0.0) == pytest.approx(weight, abs=0.01), beta
    assert sum(abs(outcome.weights.get(beta, 0.0) - weight) for beta, weight in expected.items()) < 0.02


@pytest.mark.slow
def test_moments_are_those_of_the_prior_s_samples() -> None:
    _, mean, covariance, _, _ = sampled_posterior()
    belief = curved_outcome().belief
    pose, spread = matched_moments(np.exp(belief.log_weights), belief.poses, belief.pose_covariances)
    deviation = planar_from_pose_vector(pose) - mean
    assert np.abs([*deviation[:2], wrap_angle(deviation[2])]).max() < 0.01
    np.testing.assert_allclose(spread[:2, :2], covariance, atol=3e-3)
    assert belief.object_poses.shape == (3, 7) and np.isfinite(belief.object_covariances).all()


@pytest.mark.slow
def test_points_are_poses_whose_heading_nobody_measures() -> None:
    """The path of unequal sizes against that of equal ones; samples of more dimensions are other samples."""
    poses, points = run_points(PosesForPoints(**vars(curved_world()))), curved_outcome()
    assert poses.log_evidence == pytest.approx(points.log_evidence, abs=5e-3)
    for beta, weight in points.weights.items():
        assert poses.weights[beta] == pytest.approx(weight, abs=1e-3)
    moments = [
        matched_moments(np.exp(b.log_weights), b.poses, b.pose_covariances) for b in (poses.belief, points.belief)
    ]
    for one, other in zip(*moments, strict=True):
        np.testing.assert_allclose(one, other, atol=5e-3)


def test_a_large_map_of_points_is_that_of_poses() -> None:
    """More landmarks than are looked at, or whose joint covariance is read: map gate and single marginals."""
    random = np.random.default_rng(8)
    grid = np.array(list(product(np.arange(1.0, 13.0, 2.0), np.arange(-5.3, 6.7, 2.0))))
    sigma = np.diag([0.1, 0.03])
    motions = [Motion(np.array([0.5, 0.0, 0.1]), np.diag([0.05, 0.05, 0.02]) ** 2)] * 3
    start = GaussianPrior(np.zeros(3), np.diag([0.4, 0.4, 0.05]) ** 2)
    frames = []
    for x in drive(np.array([0.3, -0.3, 0.04]), motions, random):
        seen = sorted((body_point(x, place) for place in grid), key=lambda point: float(np.hypot(*point)))
        polar = [np.array([np.hypot(*p), np.arctan2(p[1], p[0])]) + sigma @ random.normal(size=2) for p in seen[:3]]
        frames.append([range_bearing(r * np.array([np.cos(b), np.sin(b)]), sigma**2) for r, b in polar])
    spread, model = 0.01 * np.eye(2), PointObservation()
    world = PointWorld(start, grid, spread, motions, frames, model, weights=WeightsConfiguration())
    points, poses = run_points(world), run_points(PosesForPoints(**vars(world)))
    assert len(world.points) > MOST_JOINT and len(world.points) > FEW_OBJECTS
    assert points.belief.object_poses.shape == (36, 7) and np.isfinite(points.belief.object_covariances).all()
    assert max(points.weights.values()) > 0.5
    for beta, weight in points.weights.items():
        assert poses.weights.get(beta, 0.0) == pytest.approx(weight, abs=2e-3)
    np.testing.assert_allclose(points.belief.object_poses[:, :2], poses.belief.object_poses[:, :2], atol=2e-3)
    np.testing.assert_allclose(
        points.belief.object_covariances[:, :2, :2], poses.belief.object_covariances[:, :2, :2], atol=2e-3
    )


def test_samples_of_all_states_have_the_smoother_s_moments() -> None:
    """Robots and points of different sizes in one vector, in the order of their keys."""
    component = closed_root(pinned_world().problem())
    samples = StateSamples.of(component, 40_000, seed=1)
    keys = [robot_key(-1), object_key(2), object_key(0)]
    drawn = np.concatenate([samples.deviations[:, samples.rows[key]] for key in keys], axis=1)
    expected = component.joint_covariance(keys)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(np.cov(drawn.T) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.03)
    part = component.joint_covariance([object_key(0), robot_key(-1)])
    np.testing.assert_allclose(part, expected[np.ix_([5, 6, 0, 1, 2], [5, 6, 0, 1, 2])], atol=1e-12)


class PosesForPoints(PointWorld):
    """The same world with landmarks that have a heading, as the planar engine has them."""

    def problem(self) -> Problem:
        plain = super().problem()
        landmarks = tuple(replace(entry, prior=_with_heading(entry.prior)) for entry in plain.objects)
        spaces, model = Spaces.same(PlanarPoses()), PlanarObservation(None, PlanarVisibility())
        return replace(plain, spaces=spaces, model=model, objects=landmarks)


def _with_heading(prior: GaussianPrior) -> GaussianPrior:
    covariance = np.diag([0.0, 0.0, 1e-4])
    covariance[:2, :2] = prior.covariance
    return GaussianPrior(np.append(prior.mean, 0.0), covariance)


def test_the_number_of_backends_changes_nothing() -> None:
    divided, single = run_points(curved_world(), 2), curved_outcome()
    assert divided.histories == single.histories
    np.testing.assert_array_equal(divided.belief.log_weights, single.belief.log_weights)
    np.testing.assert_array_equal(divided.belief.poses, single.belief.poses)


# The heading pinned, linear measurements: against the linear-Gaussian closed form.

PINNED_RAD = 1e-7
HEADING = 0.7


def pinned_world(*, given: bool = False) -> PointWorld:
    random = np.random.default_rng(11)
    noise = np.array([[0.3, 0.05], [0.05, 0.2]])
    pinned = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, PINNED_RAD**2]])
    motion = Motion(np.array([0.5, 0.1, 0.3]), pinned.copy())
    motion.covariance[:2, :2] = [[0.02, 0.005], [0.005, 0.01]]
    start = GaussianPrior(np.array([0.2, -0.1, HEADING]), pinned.copy())
    start.covariance[:2, :2] = [[0.3, 0.1], [0.1, 0.2]]
    truth = se2.compose(start.mean, np.array([0.3, -0.2, 0.0]))
    motions = [motion] * 2
    frames = []
    for x, seen in zip(drive(truth, motions, random), SEEN, strict=True):
        frames.append([body_point(x, POINTS[n]) + random.multivariate_normal(np.zeros(2), noise) for n in seen])
    spread = np.array([[0.2, 0.05], [0.05, 0.15]])
    world = PointWorld(start, POINTS, spread, motions, frames, BodyPointObservation(noise))
    return replace(world, points=POINTS[:0], association="given", names=("a", "b")) if given else world


def rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def closed_form(world: PointWorld, history: tuple, points: np.ndarray, spread: np.ndarray):
    """Log evidence, and mean and covariance of [t_0, t_1 .. t_K, o_1 .. o_N], under one association.

    With known headings h_k: t_0 = m + R(h_0) e, t_k = t_{k-1} + R(h_{k-1}) u + R(h_k) w, z = R(h_k)^T (o - t_k) + v.
    """
    K, N = len(world.motions), len(points)
    size = 2 * (1 + K + N)
    mean, F = np.zeros(size), np.eye(size)  # states = F (independent noises) + mean
    Q = np.zeros((size, size))
    heading, position = world.start.mean[2], world.start.mean[:2]
    mean[:2] = position
    Q[:2, :2] = rotation(heading) @ world.start.covariance[:2, :2] @ rotation(heading).T
    headings = []
    for k, motion in enumerate(world.motions, start=1):
        position = position + rotation(heading) @ motion.control[:2]
        heading = heading + motion.control[2]
        headings.append(heading)
        own = slice(2 * k, 2 * k + 2)
        mean[own] = position
        Q[own, own] = rotation(heading) @ motion.covariance[:2, :2] @ rotation(heading).T
        for earlier in range(k):
            F[own, 2 * earlier : 2 * earlier + 2] = np.eye(2)
    for n, point in enumerate(points):
        own = slice(2 * (1 + K + n), 2 * (2 + K + n))
        mean[own], Q[own, own] = point, spread
    P = F @ Q @ F.T
    H, z = [], []
    for k, (frame, beta) in enumerate(zip(world.frames, history, strict=True)):
        for item, n in zip(frame, beta, strict=True):
            row = np.zeros((2, size))
            row[:, 2 * (1 + k) : 2 * (2 + k)] = -rotation(headings[k]).T
            row[:, 2 * (1 + K + n) : 2 * (2 + K + n)] = rotation(headings[k]).T
            H.append(row)
            z.append(item)
    H, z = np.concatenate(H), np.concatenate(z)
    R = np.kron(np.eye(len(z) // 2), world.model.covariance)
    S, innovation = H @ P @ H.T + R, z - H @ mean
    log_evidence = -0.5 * (innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(2.0 * np.pi * S)[1])
    covariance = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.solve(R, H))
    return log_evidence, mean + covariance @ H.T @ np.linalg.solve(R, innovation), covariance


def test_a_pinned_heading_is_the_linear_gaussian_closed_form() -> None:
    """Weights and evidence of all 36 histories; means and covariances of robot and points."""
    world = pinned_world()
    outcome = run_points(world)
    histories = list(product(PAIRS, repeat=2))
    exact = {beta: closed_form(world, beta, POINTS, world.spread) for beta in histories}
    logs = np.array([exact[beta][0] for beta in histories])
    weights = dict(zip(histories, np.exp(logs - np.logaddexp.reduce(logs)), strict=True))
    assert sorted(weights.values())[-2] > 0.01
    assert set(outcome.weights) == set(histories)
    mixture, rows = np.zeros(2), {beta: row for row, beta in enumerate(outcome.histories)}
    for beta, (log_evidence, mean, covariance) in exact.items():
        row = rows[beta]
        assert outcome.weights[beta] == pytest.approx(weights[beta], abs=1e-6)
        assert outcome.belief.log_weights[row] + outcome.log_evidence == pytest.approx(log_evidence, abs=1e-6)
        np.testing.assert_allclose(outcome.belief.poses[row, :2], mean[4:6], atol=1e-6)
        np.testing.assert_allclose(outcome.belief.pose_covariances[row, :2, :2], covariance[4:6, 4:6], atol=1e-6)
        mixture += weights[beta] * mean[6:8]
    np.testing.assert_allclose(outcome.belief.object_poses[0, :2], mixture, atol=1e-6)


def test_points_that_detections_name_are_found_by_the_closed_form() -> None:
    """No map: each identity becomes a point with a broad prior, 1 km wide."""
    world = pinned_world(given=True)
    outcome = run_points(world)
    _, mean, covariance = closed_form(world, ((0, 1), (0, 1)), np.zeros((2, 2)), 1e6 * np.eye(2))
    assert outcome.histories == [((0, 1), (0, 1))]
    np.testing.assert_allclose(outcome.belief.poses[0, :2], mean[4:6], atol=1e-5)
    np.testing.assert_allclose(outcome.belief.object_poses[:, :2], mean[6:].reshape(2, 2), atol=1e-5)
    np.testing.assert_allclose(outcome.belief.object_covariances[0, :2, :2], covariance[6:8, 6:8], atol=1e-5)
