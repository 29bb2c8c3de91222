"""Upright bodies without a map: range and ray say nothing of an attitude, so the world is that of points."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2
from worlds.scenes.bodies import drive, level_run, planar_run
from worlds.scenes.open_flights import FINE, POOR, Errors, LookingFlight, OpenFlight, from_around

from semantic_slam import HybridBelief, MapPrior, ObjectPrior
from semantic_slam.configuration import NewObjectConfiguration
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.models.spatial.bodies import BodyObservation
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.spatial.births import births_in_space
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.states.kinds.spatial_poses import SpatialPoses
from semantic_slam.inference.states.kinds.spatial_positions import SpatialPositions
from semantic_slam.viewpoint.model import log_density
from semantic_slam.viewpoint.parametric import ParametricModel

POSE = se3.exp(np.array([0.4, -0.3, 0.8, 1.0, 2.0, 3.0]))
REGION = SpatialRegion(min_range_m=0.5, max_range_m=3.0, half_width_rad=0.7, half_height_rad=0.4)
LABELS = ("cup", "bottle", "book")
PLACE_SIGMA_M = 0.05


def mapped(points: np.ndarray, yaws: np.ndarray, yaw_sigma_rad: float = 1e-4) -> MapPrior:
    """Half of the ``points`` (12, 3), not quite where they are, and how they are turned."""
    turns = np.zeros((len(points), 3))
    turns[:, 2] = yaws
    objects = [
        ObjectPrior(
            object_id=n,
            name="",
            pose=np.append(points[n] + 0.02, so3.exp(turns[n])),
            covariance=np.diag([*[PLACE_SIGMA_M**2] * 3, 0.0, 0.0, yaw_sigma_rad**2]),
            class_probabilities={},
            existence=0.8,
        )
        for n in range(0, len(points), 2)
    ]
    return MapPrior(tuple(objects))


def assert_same(own: HybridBelief, points: HybridBelief, tolerance: float) -> None:
    """Of all but the attitudes of objects."""
    every = "log_evidence log_weights poses pose_covariances existence class_probabilities innovation_nees unexplained"
    for name in every.split():
        np.testing.assert_allclose(getattr(own, name), getattr(points, name), atol=tolerance, err_msg=name)
    np.testing.assert_allclose(own.object_poses[:, :3], points.object_poses[:, :3], atol=tolerance)
    places = (own.object_covariances[:, :3, :3], points.object_covariances[:, :3, :3])
    np.testing.assert_allclose(*places, rtol=tolerance, atol=tolerance)


@pytest.mark.long
@pytest.mark.parametrize(
    ("errors", "labels", "rays", "on_map", "values"),
    [
        (Errors(), (), 0.0, False, {"revision": {"every_keyframes": 3, "horizon": 50}}),
        (Errors(), (), 0.0, True, {"odometry": {"sigma_level_rad": 0.02}, "new_objects": {"sigma_tilt_rad": 1e-4}}),
        (POOR, (), 0.0, False, {}),
        (POOR, LABELS, 0.0, False, {}),
        (Errors(), LABELS, 0.7, False, {}),
    ],
)
def test_bodies_whose_attitude_is_not_measured_are_points(
    monkeypatch: pytest.MonkeyPatch,
    errors: Errors,
    labels: tuple[str, ...],
    rays: float,
    on_map: bool,
    values: dict[str, Any],
) -> None:
    """Of the same evidence, histories, existence and places, also where pairs and histories are searched for modes.

    With all that moved relinearised: thresholds are along the axes of objects, which those of points are not. Of rays
    alone, whose searches end a little apart, to 1e-5.
    """
    for space in (SpatialPoses, SpatialPositions):
        monkeypatch.setattr(space, "relinearize_threshold", np.full(space.tangent_size, 1e-9))
    seed = 3
    points = np.random.default_rng(seed).uniform([-2.0, -2.0, 0.0], [2.0, 2.0, 1.5], (12, 3))
    objects = mapped(points, np.full(12, 0.4)) if on_map else None
    flights = [
        OpenFlight(seed, labels=labels, errors=errors, objects=objects, observation=observation, **values)
        for observation in ("range_bearing", "points")
    ]
    most = 0
    for own, of_points in zip(*(flight.beliefs(7, clutter=0.7, rays=rays) for flight in flights), strict=True):
        assert_same(own, of_points, 1e-5 if rays else 1e-6)
        most = max(most, len(own.log_weights))
    assert most > 1 or errors is not POOR


def test_what_is_born_stands_upright_wherever_the_robot_is() -> None:
    """Its position follows the robot, its attitude is gravity's; of its yaw nothing is known."""
    body, settings = np.array([0.5, -1.0, 1.5]), NewObjectConfiguration()
    distance = float(np.linalg.norm(body))
    detection = SpatialDetection(ray=body / distance, range_m=distance, covariance=np.diag([0.01, 1e-4, 4e-4]))
    model = BodyObservation(new_objects=settings)
    space = POSES_IN_SPACE.robot
    (born,) = births_in_space(space, model, [detection], POSE, REGION)
    np.testing.assert_allclose(so3.matrix(born.prior.mean[3:])[2], [0.0, 0.0, 1.0], atol=1e-12)
    steps = 1e-6 * np.eye(6)
    robots = [space.retract(POSE, step) for step in (*steps, *-steps)]
    places = np.array([births_in_space(space, model, [detection], x, REGION)[0].prior.mean[:3] for x in robots])
    slopes = space.position_slopes(born.prior.mean)
    np.testing.assert_allclose(slopes @ born.gain, (places[:6] - places[6:]).T / 2e-6, atol=1e-8)
    np.testing.assert_array_equal(born.gain[se3.ROTATION], 0.0)
    tilt, heading = settings.sigma_tilt_rad**2, settings.sigma_heading_rad**2
    np.testing.assert_allclose(born.noise[se3.ROTATION, se3.ROTATION], np.diag([tilt, tilt, heading]))
    np.testing.assert_array_equal(born.noise[se3.ROTATION, se3.TRANSLATION], 0.0)
    along = geometry_of(POSES_IN_SPACE).moving_along(POSE, born.prior.mean[None])[0]
    np.testing.assert_allclose(along, born.gain, atol=1e-12)


NAMES = ("cup", "bottle")
MODEL = ParametricModel(0.6, 3.0, NAMES)
FROM_ABOVE = np.append([0.0, 0.0, 1.8], so3.exp(np.array([0.0, 0.6, 0.0])))
YAWS = np.linspace(-np.pi, np.pi, 720, endpoint=False)


YAW_SIGMA_RAD = 0.3
"""Of those that are on the map."""


def log_likelihoods(flight: LookingFlight, on_map: MapPrior | None) -> dict[int, np.ndarray]:
    """(2, 720) log probability of each body's yaw and views, by class and yaw."""
    known = set() if on_map is None else {entry.object_id for entry in on_map.objects}
    found: dict[int, np.ndarray] = {}
    for n, camera, scores in flight.views:
        if n not in found:
            away = wrap_angle(YAWS - flight.yaws[n]) / YAW_SIGMA_RAD
            log_prior = -0.5 * away**2 if n in known else np.zeros(len(YAWS))
            found[n] = np.tile(log_prior - np.logaddexp.reduce(log_prior), (2, 1))
        for number in range(2):
            told = MODEL.predict(np.full(len(YAWS), number), from_around(camera, YAWS))
            found[n][number] += log_density(scores - told.mean, told.covariance)
    return found


@pytest.mark.parametrize("is_mapped", [False, True])
def test_classes_and_yaws_are_those_of_all_views_together(is_mapped: bool) -> None:
    """By integrals over the yaw, with every view from where it is: as near as cells of five degrees are.

    The evidence of what is seen is that of where it is, and of the views of each body. The yaw has the circular mean
    and variance.
    """
    drawn = OpenFlight(4).points, LookingFlight(4, MODEL).yaws
    on_map = mapped(*drawn, YAW_SIGMA_RAD) if is_mapped else None
    kinds: tuple[dict[str, Any], ...] = {}, {"semantic_model": {"kind": "none"}}
    given = {"errors": FINE, "start": FROM_ABOVE, "objects": on_map}
    flights = [LookingFlight(4, MODEL, **given, **kind) for kind in kinds]
    for looking, plain in zip(*(flight.beliefs(12) for flight in flights), strict=True):
        np.testing.assert_allclose(looking.object_poses[:, :3], plain.object_poses[:, :3], atol=1e-9)
    likelihoods, log_evidence = log_likelihoods(flights[0], on_map), 0.0
    for item in looking.objects:
        n = int(np.linalg.norm(flights[0].points - item.position, axis=1).argmin())
        if n not in likelihoods:  # on the map, and not seen
            continue
        log_joint = likelihoods.pop(n)
        by_class = np.logaddexp.reduce(log_joint, axis=1) - np.log(2.0)
        expected = np.exp(by_class - np.logaddexp.reduce(by_class))
        np.testing.assert_allclose(list(item.class_probabilities.values()), expected, atol=0.01)
        log_evidence += np.logaddexp.reduce(by_class)
        by_yaw = np.exp(np.logaddexp.reduce(log_joint, axis=0) - np.logaddexp.reduce(log_joint, axis=(0, 1)))
        moment = by_yaw @ np.exp(1j * YAWS)
        sigma = np.sqrt(-2.0 * np.log(abs(moment)))
        assert np.sqrt(item.covariance[5, 5]) == pytest.approx(sigma, rel=0.02)
        assert abs(wrap_angle(planar_from_pose_vector(item.pose)[2] - np.angle(moment))) < 0.1 * sigma
    assert not likelihoods
    assert flights[0].engine.log_evidence - flights[1].engine.log_evidence == pytest.approx(log_evidence, abs=0.03)


def test_a_flight_without_a_map_names_things_and_tells_how_they_are_turned() -> None:
    """Once each; named rightly where sure, and as far off in yaw as stated, where that is known to a radian."""
    flight = LookingFlight(0, ParametricModel(0.6, 6.0, NAMES))
    *_, belief = flight.beliefs(20, clutter=0.2)
    found = [item for item in belief.objects if item.existence > 0.5]
    nearest = [int(np.linalg.norm(flight.points - item.position, axis=1).argmin()) for item in found]
    assert sorted(nearest) == sorted(flight.seen)
    sure = [(item, n) for item, n in zip(found, nearest, strict=True) if max(item.class_probabilities.values()) > 0.95]
    assert len(sure) >= 3 and all(item.likeliest_class == NAMES[flight.classes[n]] for item, n in sure)
    turned = [
        wrap_angle(planar_from_pose_vector(item.pose)[2] - flight.yaws[n]) / np.sqrt(item.covariance[5, 5])
        for item, n in zip(found, nearest, strict=True)
        if item.covariance[5, 5] < 1.0
    ]
    low, high = chi2.interval(0.99, len(turned))
    assert len(turned) >= 4 and low < np.square(turned).sum() < high


def test_bodies_in_flat_space_are_those_of_the_plane() -> None:
    """On a map, with hardly a birth: weights to half a percent, classes and places to 1e-3, the pose to 1e-6."""
    frames, ends = drive(np.random.default_rng(6), named=False), {"min_range_m": 0.1, "max_range_m": 10.0}
    angles = {"field_of_view_rad": 2.0, "vertical_field_of_view_rad": 1.0}
    world = {"birth_density": 1e-6, "clutter_per_frame": 1e-6, **ends, **angles}
    values = {"association": "open", "weights": {"method": "laplace"}, "pruning": {}}
    kind = {"kind": "parametric", "alpha": 0.6, "concentration": 6.0, "outlier_share": 0.0}
    (_, flat), (_, level) = (run(frames, kind, open_world=world, **values) for run in (planar_run, level_run))
    known = slice(3)
    assert len(flat.log_weights) == 3
    np.testing.assert_allclose(np.exp(level.log_weights[known]), np.exp(flat.log_weights[known]), atol=5e-3)
    np.testing.assert_allclose(level.class_probabilities[known], flat.class_probabilities[known], atol=1e-3)
    np.testing.assert_allclose(level.object_poses[known, :2], flat.object_poses[known, :2], atol=1e-3)
    np.testing.assert_allclose(level.poses[0], flat.poses[0], atol=1e-6)
