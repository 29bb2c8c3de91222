"""Landmarks that are seen by rays alone: as sure as they are right, while nobody knows yet how far they are."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2
from worlds.exact.spatial_fixtures import spatial
from worlds.same_beliefs import assert_same

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.contracts.state_space import differences
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.inference.association.gating import pair_densities
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building.announcement import make_run_configuration
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.spatial.bodies import BodyObservation
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.log_range import ANYWHERE
from semantic_slam.inference.models.spatial.observation import POSES_AND_POINTS_IN_SPACE, SpatialObservation
from semantic_slam.inference.models.spatial.range_prior import BodyRangePrior, RangePrior
from semantic_slam.inference.models.spatial.ray_factor import ray_factor
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.spatial.births import shown_by
from semantic_slam.inference.open_world.spatial.pairs_at_modes import ParentPairs, pairs_at_modes
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.range_chart import coordinates, moved

RAY_SIGMA = 0.01
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
SPACES = POSES_AND_POINTS_IN_SPACE


def ray_to(point: np.ndarray, sensor: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> SpatialDetection:
    """A ray alone to a point of the body frame."""
    covariance = np.diag([np.nan, RAY_SIGMA**2, RAY_SIGMA**2])
    away = point - np.array(sensor)
    return SpatialDetection(
        ray=away / np.linalg.norm(away), range_m=np.nan, covariance=covariance, sensor=np.array(sensor)
    )


def test_the_prior_s_factor_by_differences() -> None:
    robot = se3.exp(np.array([0.3, -0.2, 0.9, 1.0, 2.0, 0.5]))
    prior = RangePrior.of(ANYWHERE, np.array([0.6, 0.0, 0.8]), np.array([0.1, 0.2, 0.0]), robot)
    factor, point = prior.factor(SPACES.landmark, 5), prior.mean + np.array([0.4, -0.3, 0.2])

    def error(at: np.ndarray) -> np.ndarray:
        return np.array([(np.log(np.linalg.norm(at - prior.anchor)) - ANYWHERE.mean) / ANYWHERE.sigma])

    values = gtsam.Values()
    SPACES.landmark.insert(values, 5, point)
    assert factor.error(values) == pytest.approx(0.5 * error(point)[0] ** 2)
    jacobian, _ = factor.linearize(values).jacobian()
    np.testing.assert_allclose(jacobian, differences(lambda step: error(point + step), 3), atol=1e-6)
    moved_on = prior.at(point, se3.compose(robot, se3.exp(np.array([0.0, 0.0, 0.1, 0.5, 0.0, 0.0]))))
    assert np.linalg.norm(moved_on.anchor - prior.anchor) == pytest.approx(0.5, abs=0.05)


def test_a_body_s_factors_by_differences() -> None:
    """Of the prior of its range and attitude, and of a ray from a camera beside the robot's origin."""
    space, robot = POSES_IN_SPACE.landmark, se3.exp(np.array([0.3, -0.2, 0.9, 1.0, 2.0, 0.5]))
    upright, tilt = so3.exp(np.array([0.0, 0.0, 2.0])), np.diag([0.02, 0.03, 3.0]) ** 2
    place = RangePrior.of(ANYWHERE, np.array([0.6, 0.0, 0.8]), np.array([0.1, 0.2, 0.0]), robot)
    prior = BodyRangePrior.of_body(place, upright, tilt)
    body = space.retract(prior.mean, np.array([0.03, -0.02, 2.5, 0.4, -0.3, 0.2]))
    seen = ray_to(np.array([1.0, 0.2, -0.1]), (0.2, 0.0, 0.1))

    def of_prior(at: np.ndarray) -> np.ndarray:
        turned = so3.log(so3.product(so3.inverse(upright), at[3:])) / np.sqrt(np.diagonal(tilt))
        return np.append((np.log(np.linalg.norm(at[:3] - prior.anchor)) - ANYWHERE.mean) / ANYWHERE.sigma, turned)

    def of_ray(at: np.ndarray) -> np.ndarray:
        model = BodyObservation()
        return model.geometry(model.collect([seen]), robot[None], at[None]).residual[0, 1:]

    values = gtsam.Values()
    space.insert(values, 5, body)
    space.insert(values, 6, robot)
    factors = prior.factor(space, 5), ray_factor(seen, (6, 5), has_attitude=True)
    for factor, error in zip(factors, (of_prior, of_ray), strict=True):
        assert factor.error(values) == pytest.approx(0.5 * (error(body) ** 2).sum())
        jacobian, _ = factor.linearize(values).jacobian()
        expected = differences(lambda step, error=error: error(space.retract(body, step)), 6)
        np.testing.assert_allclose(jacobian[:, -6:], expected, atol=1e-5)


@pytest.mark.parametrize("distance", [0.02, 20.0, 1e6])
def test_an_object_that_a_search_has_led_astray_comes_back(distance: float) -> None:
    """By steps of Gauss-Newton, which along the tangent lead ever farther away from eight times the expected range."""
    prior = RangePrior.of(ANYWHERE, np.array([1.0, 0.0, 0.0]), np.zeros(3), ORIGIN)
    place = np.array([distance, 0.0, 0.0])
    for _ in range(12):
        residual, slopes = prior.off(place)
        place = place - np.linalg.pinv(slopes) @ residual
    np.testing.assert_allclose(place, prior.mean, rtol=1e-6)


@pytest.mark.parametrize("baseline", [0.0, 0.05, 0.2, 0.6])
@pytest.mark.parametrize("range_m", [0.6, 1.2, 3.0])
def test_the_evidence_of_a_second_ray_is_that_over_all_ranges(baseline: float, range_m: float) -> None:
    """Against an integral over the range: to 0.3 nats where the object was expected, nowhere half a nat off."""
    found, exact = second_ray(np.array([0.0, baseline, 0.0]), range_m)
    assert found == pytest.approx(exact, abs=0.5)
    if 0.6 < range_m < 2.0:
        assert found == pytest.approx(exact, abs=0.3)


@pytest.mark.parametrize(
    ("forward", "baseline", "range_m"), [(1.5, 0.05, 2.5), (2.5, 0.05, 4.5), (2.5, 0.2, 4.5), (2.5, 0.6, 4.5)]
)
def test_an_object_expected_behind_the_camera_by_now_is_recognised_ahead(
    forward: float, baseline: float, range_m: float
) -> None:
    """It was expected 1.2 m ahead; a search from there had it at 2 to 162 nats too little."""
    found, exact = second_ray(np.array([forward, baseline, 0.0]), range_m)
    assert found == pytest.approx(exact, abs=0.5)


def second_ray(place: np.ndarray, range_m: float) -> tuple[float, float]:
    """Log density of a ray from ``place`` to an object ``range_m`` along the first one; and the integral."""
    anchor, expected = np.zeros(3), ANYWHERE.range_m * np.array([1.0, 0.0, 0.0])
    across = (RAY_SIGMA * ANYWHERE.range_m) ** 2
    covariance = np.zeros((9, 9))
    covariance[:6, :6] = 1e-10 * np.eye(6)
    covariance[6:, 6:] = np.diag([(ANYWHERE.sigma * ANYWHERE.range_m) ** 2, across, across])
    robot = np.append(place, ORIGIN[3:])
    predicted = PredictedBelief(
        SPACES.layout, SPACES.storage.stacked(robot[None], expected[None])[None], covariance[None]
    )
    detection = ray_to(np.array([range_m, 0.0, 0.0]) - place)
    model = SpatialObservation()
    pairs = pair_densities(SPACES, model, [detection], predicted)
    parent = ParentPairs(detections=[detection], predicted=predicted, anchors=anchor[None], pairs=pairs)
    (found,) = pairs_at_modes(SPACES, model, [parent])
    return found.log_density[0, 0], integrated(detection, robot, expected, covariance)


def test_pairs_are_searched_together_as_each_would_be_by_itself() -> None:
    """To the last bit, whatever parents stand beside, and whichever pairs are asked for."""
    model, random = SpatialObservation(), np.random.default_rng(5)
    detections = [ray_to(point) for point in random.uniform([1.0, -0.5, -0.5], [2.0, 0.5, 0.5], (4, 3))]
    every = [wide_pairs(model, detections, random) for _ in range(3)]
    together = pairs_at_modes(SPACES, model, every)
    asked = np.eye(4, 3, dtype=bool)
    for own, found in zip(every, together, strict=True):
        (alone,) = pairs_at_modes(SPACES, model, [own])
        (some,) = pairs_at_modes(SPACES, model, [replace(own, asked=asked)])
        assert (found.log_density != own.pairs.log_density).all()
        for name in ("residual", "jacobian_robot", "jacobian_object"):
            np.testing.assert_array_equal(getattr(found.part, name), getattr(alone.part, name))
            np.testing.assert_array_equal(getattr(found.part, name)[asked], getattr(some.part, name)[asked])
        np.testing.assert_array_equal(found.log_density, alone.log_density)
        np.testing.assert_array_equal(some.log_density, np.where(asked, found.log_density, own.pairs.log_density))


def wide_pairs(
    model: SpatialObservation, detections: list[SpatialDetection], random: np.random.Generator
) -> ParentPairs:
    """Three objects seen once along rays from near the origin, and the robot a step aside."""
    rays = random.uniform([1.0, -0.3, -0.3], [1.5, 0.3, 0.3], (3, 3))
    robot = np.append(random.uniform(-0.2, 0.2, 3), ORIGIN[3:])
    covariance = np.diag([*np.full(6, 1e-4), *np.full(9, 0.3)])
    predicted = PredictedBelief(SPACES.layout, SPACES.storage.stacked(robot[None], rays)[None], covariance[None])
    pairs = pair_densities(SPACES, model, detections, predicted)
    return ParentPairs(detections=detections, predicted=predicted, anchors=np.zeros((3, 3)), pairs=pairs)


def integrated(detection: SpatialDetection, robot: np.ndarray, expected: np.ndarray, covariance: np.ndarray) -> float:
    """Log density of a ray: over the logarithm of the range on a grid, the rest by samples."""
    random = np.random.default_rng(0)
    sigmas = np.sqrt(np.diagonal(covariance)[6:])
    along = np.linspace(-5.0, 5.0, 801)
    aside = sigmas[1:] * random.normal(size=(200, 2))
    tangent = np.concatenate(
        [np.repeat(sigmas[0] * along, len(aside))[:, None], np.tile(aside, (len(along), 1))], axis=1
    )
    points = moved(np.zeros(3), expected, tangent)
    model = SpatialObservation()
    logs = model.log_likelihood(model.collect([detection]), np.tile(robot, (len(points), 1)), points, None)
    weights = -0.5 * np.repeat(along, len(aside)) ** 2
    return float(finite_log_sum_exp(logs + weights, axis=0) - finite_log_sum_exp(weights, axis=0))


def seen_three_times(seed: int, baseline: float) -> float:
    """Normalised squared error of a point after three rays from places ``baseline`` apart."""
    random = np.random.default_rng(seed)
    configuration = spatial(association="given", open_world={"min_range_m": 0.3, "max_range_m": 5.0})
    engine = Engine(configuration, initial_pose=ORIGIN, initial_covariance=1e-8 * np.eye(6))
    reach = np.exp(ANYWHERE.mean + ANYWHERE.sigma * random.normal())
    point = reach * np.array([1.0, *random.uniform(-0.3, 0.3, 2)])
    motion, x = np.append([0.0, baseline, 0.0], ORIGIN[3:]), ORIGIN
    for k in range(3):
        control = motion if k else ORIGIN
        x = se3.compose(x, control)
        away = point - x[:3]
        seen = away / np.linalg.norm(away) + RAY_SIGMA * random.normal(size=3)
        detection = Detection.along(seen, ray_covariance=RAY_SIGMA**2 * np.eye(3), track_id="p")
        keyframe = Keyframe.spatial(k, motion=control, motion_covariance=1e-8 * np.eye(6), detections=[detection])
        belief = engine.process(keyframe)
    found, spread = belief.object_poses[0, :3], belief.object_covariances[0, :3, :3]
    off = coordinates(np.zeros(3), found, point)
    return float(off @ np.linalg.solve(spread, off))


@pytest.mark.long
@pytest.mark.parametrize("baseline", [0.02, 0.2])
def test_a_point_is_as_surely_known_as_it_is_right(baseline: float) -> None:
    """In the logarithm of its range, whose prior is what is known: in 50 worlds, at little and at more parallax."""
    errors = np.array([seen_three_times(seed, baseline) for seed in range(50)])
    low, high = chi2.interval(0.99, 3 * len(errors))
    assert low < errors.sum() < high


REGION = SpatialRegion(min_range_m=0.5, max_range_m=3.0, half_width_rad=0.7, half_height_rad=0.4, occluder_radius_m=0.1)


def test_a_ray_may_start_an_object_anywhere_along_it() -> None:
    """Its evidence under an even intensity is the volume along it; it hides nothing, and follows the robot."""
    detection, robot = (
        ray_to(np.array([1.0, 0.2, -0.1]), (0.2, 0.0, 0.1)),
        se3.exp(np.array([0.0, 0.1, 0.4, 1.0, 2.0, 0.0])),
    )
    geometry, model = geometry_of(SPACES), SpatialObservation()
    (born,) = geometry.births(model, [detection], robot, REGION)
    assert born.log_area == pytest.approx(np.log((3.0**3 - 0.5**3) / 3.0))
    along = so3.rotated(robot[3:], detection.ray)
    known = detection.log_range
    assert along @ born.noise @ along == pytest.approx((known.sigma * known.range_m) ** 2)
    assert len(shown_by(REGION, [detection])[0]) == 0
    steps = 1e-6 * np.eye(6)
    places = [
        geometry.births(model, [detection], SPACES.robot.retract(robot, step), REGION)[0].prior.mean
        for step in (*steps, *-steps)
    ]
    slopes = (np.array(places[:6]) - np.array(places[6:])).T / 2e-6
    np.testing.assert_allclose(born.gain, slopes, atol=1e-8)


def test_what_is_estimated_along_rays_alone_is_the_optimum_of_all_factors() -> None:
    """To 0.02 nats: with variables relinearised at a tenth of a metre it was 0.16, and 4 in a walk of 35 keyframes."""
    random, sigma = np.random.default_rng(4), 0.02
    points = np.column_stack([random.uniform(low, high, 8) for low, high in ((0.6, 3.5), (-1.0, 1.0), (-0.4, 0.4))])
    configuration = Configuration.of(
        state_space="spatial", observation="points", association="given", semantic_model={"kind": "none"}
    )
    engine = Engine(configuration, initial_pose=ORIGIN, initial_covariance=1e-6 * np.eye(6))
    errors = np.array([0.003] * 3 + [0.01] * 3)
    x, motion = ORIGIN, se3.exp(np.array([0.0, 0.0, -0.06, 0.02, 0.1, 0.01]))
    for k in range(10):
        x = se3.compose(x, se3.compose(motion, se3.exp(errors * random.normal(size=6))))
        seen = [number for number in range(len(points)) if random.random() < 0.6]
        away = so3.rotated(so3.inverse(x[3:]), points[seen] - x[:3])
        rays = away / np.linalg.norm(away, axis=1)[:, None] + sigma * random.normal(size=away.shape)
        detections = [
            Detection.along(ray, ray_covariance=sigma**2 * np.eye(3), track_id=str(number))
            for ray, number in zip(rays, seen, strict=True)
        ]
        engine.process(Keyframe.spatial(k, motion=motion, motion_covariance=np.diag(errors**2), detections=detections))
        assert misfit_left(engine) < 0.02


def misfit_left(engine: Engine) -> float:
    """By how much [nats] an optimisation of the graph of the only hypothesis improves on its estimate."""
    assert isinstance(engine.pool, InProcessPool)
    ((held,),) = (backend.held.values() for backend in engine.pool._backends)
    isam = held.component.smoother.isam
    graph, estimate = gtsam.NonlinearFactorGraph(isam.getFactorsUnsafe()), isam.calculateEstimate()
    optimum = gtsam.LevenbergMarquardtOptimizer(graph, estimate).optimize()
    return float(graph.error(estimate) - graph.error(optimum))


def looking_along_rays(pool: InProcessPool) -> tuple[Engine, list[HybridBelief]]:
    """Beliefs about points seen by rays alone, two of them next to each other, and a false alarm now and then."""
    random, points = np.random.default_rng(3), np.array([[1.8, 0.4, 0.2], [1.9, 0.3, 0.2], [1.5, -0.4, -0.1]])
    configuration = Configuration.of(
        state_space="spatial",
        observation="points",
        association="open",
        semantic_model={"kind": "none"},
        open_world={"birth_density": 0.3, "occluder_radius_m": 0.05, "clutter_per_frame": 0.1},
        pruning={"max_hypotheses": 8},
    )
    run = make_run_configuration(configuration, None, ORIGIN, 1e-6 * np.eye(6), stamp_ns=0)
    engine = Engine.of_run(run, pool)
    x, motion, beliefs = ORIGIN, se3.exp(np.array([0.0, 0.0, 0.01, 0.0, 0.08, 0.01])), []
    for k in range(8):
        x, detections = se3.compose(x, motion), []
        seen = points if k % 3 else np.append(points, [[1.0, random.normal(scale=0.3), 0.0]], axis=0)
        for point in seen:
            away = so3.rotated(so3.inverse(x[3:]), point - x[:3])
            ray = away / np.linalg.norm(away) + RAY_SIGMA * random.normal(size=3)
            detections.append(Detection.along(ray, ray_covariance=RAY_SIGMA**2 * np.eye(3)))
        keyframe = Keyframe.spatial(k, motion=motion, motion_covariance=1e-6 * np.eye(6), detections=detections)
        beliefs.append(engine.process(keyframe))
    return engine, beliefs


@pytest.mark.long
def test_a_lineage_is_rebuilt_with_what_is_known_of_ranges() -> None:
    """A backend is lost on the way: the other one makes its hypotheses anew, anchors and all."""
    (whole, beliefs), (divided, others) = (
        looking_along_rays(pool) for pool in (InProcessPool(2), ForgetfulPool(2, dies_at=5))
    )
    assert min(len(belief.log_weights) for belief in beliefs[4:]) > 1
    for one, other in zip(beliefs, others, strict=True):
        assert_same(other, one)
    assert divided.live.keys() == whole.live.keys()


def test_mixed_keyframes_find_what_is_seen_with_a_range_and_what_is_not() -> None:
    random, points = np.random.default_rng(2), np.array([[2.0, 0.4, 0.2], [2.2, -0.5, 0.0], [1.6, 0.0, -0.2]])
    engine = Engine(
        Configuration.of(
            state_space="spatial",
            observation="points",
            association="open",
            semantic_model={"kind": "none"},
            open_world={"birth_density": 0.3, "occluder_radius_m": 0.05, "clutter_per_frame": 0.01},
        ),
        initial_pose=ORIGIN,
        initial_covariance=1e-6 * np.eye(6),
    )
    x, motion = ORIGIN, se3.exp(np.array([0.0, 0.0, 0.02, 0.02, 0.08, 0.02]))
    for k in range(10):
        x = se3.compose(x, motion)
        detections = []
        for number, point in enumerate(points):
            away = so3.rotated(so3.inverse(x[3:]), point - x[:3])
            distance = float(np.linalg.norm(away))
            told = {"ray_covariance": RAY_SIGMA**2 * np.eye(3)}
            if number == 0 or (number == 1 and k % 2):
                told |= {"range_m": distance + 0.02 * random.normal(), "sigma_range_m": 0.02}
            detections.append(Detection.along(away / distance + RAY_SIGMA * random.normal(size=3), **told))
        belief = engine.process(
            Keyframe.spatial(k, motion=motion, motion_covariance=1e-6 * np.eye(6), detections=detections)
        )
    there = belief.object_poses[belief.existence > 0.5, :3]
    assert len(there) == 3
    apart = np.linalg.norm(there[:, None] - points, axis=2)
    assert (apart.min(axis=0) < 0.15).all() and sorted(apart.argmin(axis=0).tolist()) == [0, 1, 2]
