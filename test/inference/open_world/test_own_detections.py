"""What a detection hides: others behind it, but not the object that it is of, whatever its error."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe
from semantic_slam.inference.world.map_prior import MapPrior

NEAREST_M, FARTHEST_M, HALF_WIDTH_RAD, HALF_HEIGHT_RAD, RADIUS_M = 0.3, 8.0, 0.8, 0.6, 0.25
DETECTED, SIGMA_RAD = 0.9, 0.015
AREA_M2 = HALF_WIDTH_RAD * (FARTHEST_M**2 - NEAREST_M**2)
VOLUME_M3 = 4.0 * np.arcsin(np.sin(HALF_WIDTH_RAD) * np.sin(HALF_HEIGHT_RAD)) * (FARTHEST_M**3 - NEAREST_M**3) / 3.0
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def keyframe(space: str, detections: list[Detection]) -> Keyframe:
    """Of a robot at rest."""
    if space == "spatial":
        return Keyframe.spatial(0, detections=detections, motion_covariance=1e-10 * np.eye(6))
    return Keyframe.planar(0, detections=detections, motion_sigmas=(1e-5,) * 3)


def detection(space: str, range_m: float, sigma_m: float, angles: tuple[float, float] = (0.0, 0.0)) -> Detection:
    """Of something ahead, ``angles`` to the left and up; the second is 0 in the plane."""
    if space == "spatial":
        ray = np.array([1.0, *angles])
        spread = SIGMA_RAD**2 * np.eye(3)
        return Detection.along(ray / np.linalg.norm(ray), range_m, sigma_range_m=sigma_m, ray_covariance=spread)
    return Detection(range_m=range_m, bearing_rad=angles[0], covariance=np.diag([sigma_m, SIGMA_RAD]) ** 2)


def seen_first(space: str, detections: list[Detection], rates: dict[str, float], known: MapPrior) -> HybridBelief:
    """The belief after one keyframe, from a place that is known."""
    region = {"min_range_m": NEAREST_M, "max_range_m": FARTHEST_M, "field_of_view_rad": 2.0 * HALF_WIDTH_RAD}
    region |= {"vertical_field_of_view_rad": 2.0 * HALF_HEIGHT_RAD, "occluder_radius_m": RADIUS_M}
    plain = {"merge_position_m": 0.0, "gate_sigma": 8.0, "detection_probability": DETECTED}
    values = {"state_space": space, "observation": "points"} if space == "spatial" else {}
    configuration = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world=region | plain | rates,
        pruning={"ratio": 1e12},
        **values,
    )
    size = 6 if space == "spatial" else 3
    engine = Engine(configuration, known, initial_pose=ORIGIN, initial_covariance=1e-10 * np.eye(size))
    return engine.process(keyframe(space, detections))


@pytest.mark.parametrize("space", ["planar", "spatial"])
@pytest.mark.parametrize("sigma_m", [0.3, 1.0])
def test_one_detection_alone_is_in_sight_whatever_its_error(space: str, sigma_m: float) -> None:
    np.testing.assert_allclose(in_sight(space, [3.0], sigma_m), [1.0], rtol=1e-9)


@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_of_two_detections_in_one_direction_each_is_in_sight_as_often_as_by_draws_of_both(space: str) -> None:
    sigma_m, ranges = 0.4, np.array([3.0, 4.0])
    near, far = (ranges + sigma_m * np.random.default_rng(0).normal(size=(200_000, 2))).T
    expected = [np.mean(near < far + 2.0 * RADIUS_M), np.mean(far < near + 2.0 * RADIUS_M)]
    np.testing.assert_allclose(in_sight(space, ranges.tolist(), sigma_m), expected, atol=0.01)
    assert expected[0] > 0.99 and 0.1 < expected[1] < 0.3


def in_sight(space: str, ranges_m: list[float], sigma_m: float) -> np.ndarray:
    """Probabilities that first detections are in sight, by Bayes' rule from the existence of the objects they start."""
    births, clutter = 0.03, 0.5
    rates = {"birth_density": births, "clutter_per_frame": clutter}
    detections = [detection(space, range_m, sigma_m) for range_m in ranges_m]
    exists = seen_first(space, detections, rates, MapPrior()).existence
    return exists / (1.0 - exists) * clutter / (VOLUME_M3 if space == "spatial" else AREA_M2) / (births * DETECTED)
