"""Objects first seen by a bearing alone: the second view weighs as the integral along the first ray says."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.open_world.planar.births import births_of
from semantic_slam.inference.open_world.planar.region import SensorRegion

SIGMA_BEARING, RANGE_M, SIGMA_M = 0.03, 3.0, 1.0
FARTHEST_M, DETECTED, CLUTTER, BIRTHS = 60.0, 0.9, 0.5, 1e-4
SHARE = 0.8
REGION = SensorRegion(min_range_m=0.0, max_range_m=FARTHEST_M, field_of_view_rad=2.0)


def beliefs(point: tuple[float, float], motions: list[tuple[float, float, float]], **settings: object) -> HybridBelief:
    """The last belief of a robot that sees the bearing of one point from each of the places it drives to."""
    region = {"min_range_m": 0.0, "max_range_m": FARTHEST_M, "field_of_view_rad": 2.0 * np.pi}
    rates = {"detection_probability": DETECTED, "clutter_per_frame": CLUTTER, "birth_density": BIRTHS}
    plain = {"least_undetected_share": 1.0, "occluder_radius_m": 0.0, "iterate_updates": False}
    chosen = {
        "new_objects": {"range_m": RANGE_M, "sigma_position_m": SIGMA_M},
        "open_world": {**region, **rates, **plain},
        **settings,
    }
    configuration = Configuration.of(association="open", semantic_model={"kind": "none"}, **chosen)
    engine, robot = Engine(configuration, initial_covariance=np.diag([1e-10] * 3)), np.zeros(3)
    for k, motion in enumerate([(0.0, 0.0, 0.0), *motions]):
        robot = se2.compose(robot, np.array(motion))
        x, y = se2.between(robot, np.array([*point, 0.0]))[:2]
        seen = Detection(bearing_rad=np.arctan2(y, x), covariance=np.diag([1.0, SIGMA_BEARING**2]))
        belief = engine.process(Keyframe.planar(k, motion=motion, detections=[seen], motion_sigmas=(1e-5,) * 3))
    return belief


def log_ratio(belief: HybridBelief) -> float:
    """Log ratio of the weights of the hypothesis that the second view is of the first object, and of another."""
    weights = {own.associations: own.weight for own in belief.hypotheses}
    return float(np.log(weights[(0,)] / weights[(1,)]))


def log_ratio_of(density: float) -> float:
    """That ratio for the density [1/rad] of the second bearing given the first object."""
    born = BIRTHS * np.pi * FARTHEST_M**2 * DETECTED
    exists = born / (born + CLUTTER)
    missed = 1.0 - exists * DETECTED
    return float(np.log(exists * DETECTED * density) - np.log(missed * (born + CLUTTER) / (2.0 * np.pi)))


def density_along_the_ray(point: tuple[float, float], robot: Array) -> float:
    """Density of the second bearing, by a sum over distances and directions from the first place."""
    first = np.arctan2(point[1], point[0])
    reach, turn = np.meshgrid(np.linspace(0.01, RANGE_M + 6.0 * SIGMA_M, 800), SIGMA_BEARING * np.linspace(-5, 5, 101))
    x, y = reach * np.cos(first + turn), reach * np.sin(first + turn)
    away = ((x - RANGE_M * np.cos(first)) ** 2 + (y - RANGE_M * np.sin(first)) ** 2) / SIGMA_M**2
    shares = reach * np.exp(-0.5 * away - 0.5 * (turn / SIGMA_BEARING) ** 2)
    seen = np.arctan2(point[1] - robot[1], point[0] - robot[0])
    off = np.arctan2(y - robot[1], x - robot[0]) - seen
    density = np.exp(-0.5 * (off / SIGMA_BEARING) ** 2) / (np.sqrt(2.0 * np.pi) * SIGMA_BEARING)
    return float((shares * density).sum() / shares.sum())


@pytest.mark.parametrize("motion", [(0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, -0.3, 0.0)])
def test_a_second_bearing_weighs_as_the_integral_along_the_first_ray(motion: tuple[float, float, float]) -> None:
    point = (3.0, 1.0)
    expected = log_ratio_of(density_along_the_ray(point, np.array(motion)))
    assert log_ratio(beliefs(point, [motion])) == pytest.approx(expected, abs=0.25)


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_a_repeated_error_makes_the_same_bearing_from_the_same_place_likelier(turn: float) -> None:
    """Both bearings are jointly Gaussian: the variance of the second is that of its error given the first."""
    errors = {"correlated_share": SHARE, "motion_m": 1.0, "motion_rad": 1.0}
    measured, placed = SIGMA_BEARING**2, (SIGMA_M / RANGE_M) ** 2
    repeated = placed + SHARE * np.exp(-turn) * measured
    variance = placed + measured - repeated**2 / (placed + measured)
    expected = log_ratio_of(1.0 / np.sqrt(2.0 * np.pi * variance))
    found = log_ratio(beliefs((3.0, 1.0), [(0.0, 0.0, turn)], detection_errors=errors))
    assert found == pytest.approx(expected, abs=0.02)


def test_driving_past_an_object_starts_no_second_one() -> None:
    region = {"max_range_m": 8.0, "field_of_view_rad": 3.0, "birth_density": 0.1, "clutter_per_frame": 0.1}
    rates = {"occluder_radius_m": 0.0, "iterate_updates": False}
    belief = beliefs((3.0, 1.5), [(0.4, 0.0, 0.0)] * 2, open_world={**region, **rates}, new_objects={})
    assert belief.existence[0] > 0.99
    assert belief.existence[1:].max() < 0.05


@pytest.mark.parametrize("sensor", [(0.0, 0.0), (0.4, -1.2)])
@pytest.mark.parametrize("sigma_bearing", [1e-4, 0.03, 2.0])
def test_the_object_of_a_bearing_is_its_prior_given_the_bearing(
    sensor: tuple[float, float], sigma_bearing: float
) -> None:
    """Kalman update by the bearing, whose Jacobian is a quarter turn of the direction over the distance."""
    bearing, robot = 0.7, np.array([2.0, -1.0, 0.4])
    detection = PlanarDetection(
        range_m=np.nan,
        bearing_rad=bearing,
        covariance=np.diag([1.0, sigma_bearing**2]),
        sensor=np.array(sensor),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )
    (born,) = births_of(PlanarObservation(None, PlanarVisibility()), [detection], robot, REGION)
    slope = np.array([-np.sin(bearing), np.cos(bearing)]) / RANGE_M
    prior = born.spread[:2, :2]
    innovation = slope @ prior @ slope + sigma_bearing**2
    gain = prior @ slope / innovation
    np.testing.assert_allclose(born.noise[:2, :2], prior - np.outer(gain, gain) * innovation, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(born.by_error[:2, 1], gain * sigma_bearing, rtol=1e-9)
    assert born.log_stand_in == pytest.approx(-0.5 * np.log(2.0 * np.pi * innovation))
    np.linalg.cholesky(born.noise)
