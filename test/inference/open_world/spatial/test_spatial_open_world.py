"""Objects that come to exist in space: where the camera sees, what hides what, and a flight without a map."""

from collections.abc import Sequence

import numpy as np
import pytest
from worlds.scenes.open_flights import AHEAD, OpenFlight

from semantic_slam import HybridBelief
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.association.gating import pair_densities
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.spatial.camera import LOOKS_AHEAD
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.observation import POSES_AND_POINTS_IN_SPACE, SpatialObservation
from semantic_slam.inference.open_world.joint.linear_evidence import LinearisedEvidence
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.rings import rings
from semantic_slam.inference.open_world.spatial.births import births_in_space
from semantic_slam.inference.open_world.spatial.looks import looks
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.states.kinds.spatial_positions import SpatialPositions

REGION = SpatialRegion(min_range_m=0.5, max_range_m=3.0, half_width_rad=0.7, half_height_rad=0.4, occluder_radius_m=0.1)
POSE = se3.exp(np.array([0.4, -0.3, 0.8, 1.0, 2.0, 3.0]))
OPTICAL_BODY = np.append(np.zeros(3), LOOKS_AHEAD[3:])


def drawn(count: int = 400_000) -> np.ndarray:
    """Points of the optical frame, even in a box of 7 x 5 x 4 m about the region."""
    return np.random.default_rng(0).uniform([-3.5, -2.5, 0.0], [3.5, 2.5, 4.0], (count, 3))


def test_the_region_s_volume_is_that_of_what_it_holds() -> None:
    points = drawn()
    assert REGION.volume_m3 == pytest.approx(140.0 * REGION.holds(points).mean(), rel=0.02)
    everywhere, shares = REGION.all_over(rings(REGION.min_range_m, REGION.max_range_m, (np.inf,), 3))
    assert REGION.holds(everywhere).all() and shares.sum() == pytest.approx(1.0)
    inside = points[REGION.holds(points)]
    np.testing.assert_allclose(shares @ everywhere, inside.mean(axis=0), atol=0.03)
    np.testing.assert_allclose(shares @ everywhere**2, (inside**2).mean(axis=0), rtol=0.06)


@pytest.mark.parametrize(
    "centre", [[0.0, 0.0, 2.0], [1.3, 0.1, 1.5], [0.2, -0.9, 2.0], [0.1, 0.2, 2.9], [0.0, 0.0, -1.0]]
)
def test_an_uncertain_object_lies_inside_as_often_as_its_samples_do(centre: list[float]) -> None:
    spread = np.diag([0.02, 0.01, 0.015])
    samples = np.random.default_rng(1).multivariate_normal(centre, spread, 100_000)
    assert REGION.contains(np.array(centre), spread) == pytest.approx(REGION.holds(samples).mean(), abs=0.03)


def test_what_stands_behind_a_detection_is_hidden_and_what_stands_beside_or_before_it_is_not() -> None:
    shown, variances, exact = np.array([[0.1, -0.2, 1.0]]), np.zeros((1, 2)), np.zeros((3, 3, 3))
    seen = np.array([1.8 * shown[0], 0.7 * shown[0], [0.5, -0.4, 2.0]])
    np.testing.assert_allclose(REGION.not_occluded(seen, exact, shown, variances), [0.0, 1.0, 1.0], atol=1e-9)
    ahead = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    at, hiding = REGION.camera.in_body(seen), REGION.camera.in_body(shown)
    numbers, times, ranges = looks(REGION, ahead, at, hiding)
    np.testing.assert_array_equal(numbers, [1, 2])
    np.testing.assert_array_equal(times, [0, 0])
    np.testing.assert_allclose(ranges, np.linalg.norm(seen[1:], axis=1))
    np.testing.assert_array_equal(looks(REGION, ahead, at, np.zeros((0, 3)))[0], [0, 1, 2])


def test_objects_follow_a_robot_as_their_slopes_say() -> None:
    """Those that move along with it, and those that a detection starts."""
    geometry, space = geometry_of(POSES_AND_POINTS_IN_SPACE), POSES_AND_POINTS_IN_SPACE.robot
    body = np.array([0.5, -1.0, 1.5])
    ray = body / np.linalg.norm(body)
    detection = SpatialDetection(ray=ray, range_m=float(np.linalg.norm(body)), covariance=np.diag([0.01, 1e-4, 4e-4]))
    (born,) = births_in_space(SpatialPositions(), SpatialObservation(), [detection], POSE, REGION)
    place = space.displacement(POSE, body, np.zeros(3))
    np.testing.assert_allclose(born.prior.mean, place, atol=1e-12)
    steps = 1e-6 * np.eye(6)
    moved = [space.displacement(space.retract(POSE, step), body, np.zeros(3)) for step in (*steps, *-steps)]
    slopes = (np.array(moved[:6]) - np.array(moved[6:])).T / 2e-6
    np.testing.assert_allclose(geometry.moving_along(POSE, place[None])[0], slopes, atol=1e-8)
    np.testing.assert_allclose(born.gain, slopes, atol=1e-8)


def test_the_noise_of_a_born_object_is_that_of_its_ray_and_range() -> None:
    random, covariance = np.random.default_rng(4), np.diag([0.01, 1e-4, 4e-4])
    detection = SpatialDetection(ray=np.array([0.6, 0.0, 0.8]), range_m=2.0, covariance=covariance)
    off = random.multivariate_normal(np.zeros(3), covariance, 200_000)
    rays = detection.ray + off[:, 1:] @ detection.basis.T
    points = (2.0 + off[:, :1]) * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    sampled = np.cov(so3.matrix(POSE[3:]) @ points.T)
    (born,) = births_in_space(SpatialPositions(), SpatialObservation(), [detection], POSE, REGION)
    np.testing.assert_allclose(born.noise, sampled, atol=2e-4)


def test_where_an_object_is_born_is_the_same_to_the_last_bit_whatever_is_weighed_beside_it() -> None:
    """One detection is of any of thirty objects, which move the robot; the other starts an object."""
    random, spaces = np.random.default_rng(6), POSES_AND_POINTS_IN_SPACE
    ahead = so3.rotated(POSE[3:], np.array([2.0, 0.0, 0.0]))
    mean = np.zeros((31, spaces.storage.width))
    mean[0], mean[1:, :3] = POSE, POSE[:3] + ahead + 0.1 * random.normal(size=(30, 3))
    root = 0.1 * random.normal(size=(spaces.layout.size(30),) * 2)
    covariance = root @ root.T + 1e-4 * np.eye(len(root))
    error = np.diag([0.01, 1e-4, 4e-4])
    detections = [SpatialDetection(ray=np.array([1.0, 0.0, 0.0]), range_m=r, covariance=error) for r in (2.0, 1.5)]
    model = SpatialObservation()
    linear = LinearisedEvidence(
        spaces=spaces,
        mean=mean,
        covariance=covariance,
        pairs=pair_densities(spaces, model, detections, PredictedBelief(spaces.layout, mean[None], covariance[None])),
        births=births_in_space(spaces.landmark, model, detections, POSE, REGION),
        turns=np.zeros(2),
    )
    columns = np.stack([np.arange(30), np.full(30, 31)], axis=1)

    def places(rows: np.ndarray) -> np.ndarray:
        own = Assignments(parents=np.zeros(len(rows), dtype=int), objects=rows)
        return linear.evaluate(own, rows).column("object_states")

    alone = np.concatenate([places(columns[n : n + 1]) for n in range(30)])
    np.testing.assert_array_equal(alone, places(columns))


LABELS = ("cup", "bottle", "book")


def flown(seed: int, T_ahead_body: np.ndarray, labels: Sequence[str] = ()) -> tuple[HybridBelief, np.ndarray, set[int]]:
    """A belief after 25 keyframes among 12 points, those points, and which of them were in the image at all."""
    flight = OpenFlight(seed, T_ahead_body, labels)
    *_, belief = flight.beliefs(25)
    return belief, flight.points, flight.seen


@pytest.mark.long
def test_a_flight_without_a_map_finds_what_is_there() -> None:
    belief, points, seen = flown(1, AHEAD, LABELS)
    found = [item for item in belief.objects if item.existence > 0.5]
    nearest = [int(np.linalg.norm(points - item.position, axis=1).argmin()) for item in found]
    assert sorted(nearest) == sorted(seen) and len(seen) >= 8
    assert max(np.linalg.norm(points[n] - item.position) for n, item in zip(nearest, found, strict=True)) < 0.25
    assert [item.likeliest_class for item in found] == [LABELS[n % 3] for n in nearest]
    assert belief.state_space == "spatial"


@pytest.mark.long
def test_a_flight_is_the_same_whichever_axes_the_body_has() -> None:
    ahead, optical = (flown(2, body)[0] for body in (AHEAD, OPTICAL_BODY))
    np.testing.assert_allclose(optical.object_poses, ahead.object_poses, atol=1e-6)
    np.testing.assert_allclose(optical.existence, ahead.existence, atol=1e-6)
    np.testing.assert_allclose(optical.log_weights, ahead.log_weights, atol=1e-5)
