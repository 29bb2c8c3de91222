"""What a detection hides: others behind it, but not the object that it is of, whatever its error."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

NEAREST_M, FARTHEST_M, HALF_WIDTH_RAD, HALF_HEIGHT_RAD, RADIUS_M = 0.3, 8.0, 0.8, 0.6, 0.25
DETECTED, SIGMA_RAD, SIGMA_PLACE_M = 0.9, 0.015, 0.05
AREA_M2 = HALF_WIDTH_RAD * (FARTHEST_M**2 - NEAREST_M**2)
VOLUME_M3 = 4.0 * np.arcsin(np.sin(HALF_WIDTH_RAD) * np.sin(HALF_HEIGHT_RAD)) * (FARTHEST_M**3 - NEAREST_M**3) / 3.0
AHEAD = np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
NOTHING_ELSE = {"birth_density": 1e-9, "clutter_per_frame": 1e-9}


def detection(space: str, range_m: float, sigma_m: float, off_rad: Array | tuple[float, ...] = ()) -> Detection:
    """Of something ahead, or ``off_rad`` to the left, and in space upwards."""
    left, up = np.pad(off_rad, (0, 2 - len(off_rad)))
    if space == "planar":
        return Detection(range_m=range_m, bearing_rad=left, covariance=np.diag([sigma_m, SIGMA_RAD]) ** 2)
    ray = np.array([1.0, left, up]) / np.linalg.norm([1.0, left, up])
    return Detection.along(ray, range_m, sigma_range_m=sigma_m, ray_covariance=SIGMA_RAD**2 * np.eye(3))


def beliefs(space: str, frames: list[list[Detection]], known: MapPrior, **world: float) -> list[HybridBelief]:
    """Of a robot at rest that knows where it is."""
    region = {"min_range_m": NEAREST_M, "max_range_m": FARTHEST_M, "field_of_view_rad": 2.0 * HALF_WIDTH_RAD}
    region |= {"vertical_field_of_view_rad": 2.0 * HALF_HEIGHT_RAD, "occluder_radius_m": RADIUS_M}
    plain = {"merge_position_m": 0.0, "gate_sigma": 8.0, "detection_probability": DETECTED}
    configuration = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world=region | plain | world,
        pruning={"ratio": 1e12},
        **({} if space == "planar" else {"state_space": "spatial", "observation": "points"}),
    )
    start = {"initial_pose": np.append(np.zeros(6), 1.0), "initial_covariance": 1e-10 * np.eye(6)}
    if space == "planar":
        engine = Engine(configuration, known, initial_covariance=1e-10 * np.eye(3))
        keyframes = [Keyframe.planar(k, detections=own, motion_sigmas=(1e-5,) * 3) for k, own in enumerate(frames)]
    else:
        engine, still = Engine(configuration, known, **start), 1e-10 * np.eye(6)
        keyframes = [Keyframe.spatial(k, detections=own, motion_covariance=still) for k, own in enumerate(frames)]
    return [engine.process(keyframe) for keyframe in keyframes]


def in_sight(space: str, ranges_m: list[float], sigma_m: float) -> Array:
    """Probabilities that first detections are in sight, by Bayes' rule from the existence of the objects they start."""
    births, clutter = 0.03, 0.5
    frame = [detection(space, range_m, sigma_m) for range_m in ranges_m]
    (found,) = beliefs(space, [frame], MapPrior(), birth_density=births, clutter_per_frame=clutter)
    false_alarms = clutter / (AREA_M2 if space == "planar" else VOLUME_M3)
    return found.existence / (1.0 - found.existence) * false_alarms / (births * DETECTED)


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


def known_ahead() -> MapPrior:
    """Of one object that exists, about as well known as its direction is measured."""
    spread = np.diag([SIGMA_PLACE_M] * 3 + [0.3] * 3) ** 2
    return MapPrior((ObjectPrior(object_id=0, name="0", class_probabilities={}, pose=AHEAD, covariance=spread),))


@pytest.mark.parametrize("space", ["planar", pytest.param("spatial", marks=pytest.mark.long)])
def test_a_known_object_alone_in_the_middle_of_the_view_is_either_seen_or_missed(space: str) -> None:
    """The evidence of a keyframe without detections, and of those with one, wherever it is, add up to 1.

    Integrated by Gauss-Hermite quadrature: the density of the detection is next to Gaussian.
    """

    def probability(frame: list[Detection]) -> float:
        return float(np.exp(beliefs(space, [frame], known_ahead(), **NOTHING_ELSE)[0].log_evidence))

    sigma_m, size = 0.5, 2 if space == "planar" else 3
    nodes, weights = np.polynomial.hermite_e.hermegauss(3)
    scales = np.hypot([sigma_m, SIGMA_RAD, SIGMA_RAD], SIGMA_PLACE_M / np.array([1.0, AHEAD[0], AHEAD[0]]))[:size]
    seen = 0.0
    for which in np.ndindex((len(nodes),) * size):
        off, shares = nodes[list(which)], weights[list(which)] * scales
        measured = detection(space, AHEAD[0] + off[0] * scales[0], sigma_m, off[1:] * scales[1:])
        seen += float((shares * np.exp(0.5 * off**2)).prod()) * probability([measured])
    missed = probability([])
    assert missed == pytest.approx(1.0 - DETECTED, abs=1e-6)
    assert seen + missed == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize(
    ("space", "learned"), [("planar", False), ("planar", True), ("spatial", False)], ids=["plane", "learned", "space"]
)
def test_an_object_that_is_seen_alone_weighs_the_same_whatever_hides_others(space: str, learned: bool) -> None:
    """Detected twice, then missed, then detected again; ``learned``: in a region learned from the detections."""
    seen = [detection(space, range_m, 0.5) for range_m in (3.2, 2.7, 3.4)]
    frames = [[seen[0]], [seen[1]], [], [seen[2]]]

    def log_evidence(radius_m: float) -> list[float]:
        world = {"occluder_radius_m": radius_m, "learn_region": learned, **NOTHING_ELSE}
        return [own.log_evidence for own in beliefs(space, frames, known_ahead(), **world)]

    np.testing.assert_allclose(log_evidence(RADIUS_M), log_evidence(0.0), atol=1e-6)
