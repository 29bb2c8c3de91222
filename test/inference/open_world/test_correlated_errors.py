"""Errors of detections that repeat: against the joint Gaussian of a whole drive, and what they leave unknown."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from worlds.drives.open_room import make_room
from worlds.same_beliefs import assert_same

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_covariance
from semantic_slam.inference.models.correlated_errors import CHANGE_OF_SENSOR
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

TWINS = np.array([[3.0, 0.1], [3.0, -0.1]])
SIGMA_OBJECT, SIGMA_RANGE, SIGMA_BEARING = 4e-4, 3e-4, 1e-4
START, STEP_SIGMA = 2e-4, 1e-4
MOTION = np.array([0.2, 0.05, 0.1])
ERRORS = {
    "correlated_share": 0.9,
    "common_range_share": 0.3,
    "common_bearing_share": 0.7,
    "neighbour_m": 0.4,
    "motion_m": 2.0,
    "motion_rad": 4.0,
}
SENSOR = {"sigma_range_offset_m": 1e-3, "sigma_yaw_rad": 1e-3}
KEYFRAMES = 5


def configuration(errors: dict[str, float], **open_world: float) -> Configuration:
    region = {"min_range_m": 0.3, "max_range_m": 8.0, "field_of_view_rad": 2.0, "occluder_radius_m": 0.0}
    return Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world={"iterate_updates": False, **region, **open_world},
        detection_errors=errors,
    )


def seen_from(robot: np.ndarray, point: np.ndarray) -> np.ndarray:
    d = se2.between(robot, np.array([*point, 0.0]))[:2]
    return np.array([np.hypot(*d), np.arctan2(d[1], d[0])])


def robots() -> list[np.ndarray]:
    found = [np.zeros(3)]
    for _ in range(KEYFRAMES):
        found.append(se2.compose(found[-1], MOTION))
    return found[1:]


class JointGaussian:
    """Start, steps, objects and errors of the drive as one vector of independent causes, linearised at the truth."""

    def __init__(self, share: float, sensor: dict[str, float] | None = None) -> None:
        self.share, self.poses, self.sensor = share, robots(), sensor or {}
        self.prior = np.concatenate([np.full(3, START), np.full(3 * KEYFRAMES, STEP_SIGMA), np.full(4, SIGMA_OBJECT)])
        self.slopes = np.array([self._slopes(k) for k in range(KEYFRAMES)]).reshape(4 * KEYFRAMES, -1)

    def _measured(self, k: int, causes: np.ndarray) -> np.ndarray:
        x = causes[:3]
        for step in range(k + 1):
            x = se2.compose(se2.compose(x, MOTION), se2.exp(causes[3 + 3 * step : 6 + 3 * step]))
        points = TWINS + causes[-4:].reshape(2, 2)
        return np.concatenate([seen_from(x, point) for point in points])

    def _slopes(self, k: int) -> np.ndarray:
        size, step = len(self.prior), 1e-6
        moved = [self._measured(k, step * e) - self._measured(k, -step * e) for e in np.eye(size)]
        return np.array(moved).T / (2.0 * step)

    def noise(self) -> np.ndarray:
        """Covariance of all errors, in the order keyframe, object, range and bearing."""
        sigma = np.array([SIGMA_RANGE, SIGMA_BEARING])
        driven, turned = np.hypot(*MOTION[:2]) / ERRORS["motion_m"], MOTION[2] / ERRORS["motion_rad"]
        kernel = np.zeros((KEYFRAMES, 2, 2, KEYFRAMES, 2, 2))
        near = np.exp(-0.5 * np.sum((TWINS[0] - TWINS[1]) ** 2) / ERRORS["neighbour_m"] ** 2)
        for k in range(KEYFRAMES):
            for other in range(KEYFRAMES):
                left = np.exp(-(driven + turned) * abs(k - other))
                for c, common in enumerate((ERRORS["common_range_share"], ERRORS["common_bearing_share"])):
                    together = common + (1.0 - common) * np.array([[1.0, near], [near, 1.0]])
                    kernel[k, :, c, other, :, c] = left * together * sigma[c] ** 2
        whole = kernel.reshape(4 * KEYFRAMES, -1)
        by_sensor = self.by_sensor()
        return self.share * whole + (1.0 - self.share) * np.diag(np.diag(whole)) + by_sensor @ by_sensor.T

    def by_sensor(self) -> np.ndarray:
        """(4 K, 2 + 2 (K - 1)) errors by so much of every range and by a turn of the sensor, and by their changes."""
        slopes = np.zeros((KEYFRAMES, 2, 2, KEYFRAMES, 2))
        for k in range(KEYFRAMES):
            for cause in range(k + 1):
                size = 1.0 if cause == 0 else CHANGE_OF_SENSOR
                slopes[k, :, 0, cause, 0] = size * self.sensor.get("sigma_range_offset_m", 0.0)
                slopes[k, :, 1, cause, 1] = size * self.sensor.get("sigma_yaw_rad", 0.0)
        return slopes.reshape(4 * KEYFRAMES, -1)

    def sensor_after(self, deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(2,) means and standard deviations of what the sensor always gets wrong, per those of the prior."""
        slopes, now = self.by_sensor(), np.tile(np.eye(2), (KEYFRAMES, 1))
        now[2:] *= CHANGE_OF_SENSOR
        cross = np.linalg.solve(self.covariance(), slopes @ now).T
        return cross @ deviations, np.sqrt(np.diag(now.T @ now - cross @ slopes @ now))

    def covariance(self) -> np.ndarray:
        """Of all measurements."""
        return self.slopes @ np.diag(self.prior**2) @ self.slopes.T + self.noise()

    def deviations(self) -> np.ndarray:
        """Measurements drawn from it, less their means."""
        return np.random.default_rng(5).multivariate_normal(np.zeros(4 * KEYFRAMES), self.covariance())

    def log_density(self, deviations: np.ndarray) -> float:
        return float(multivariate_normal(np.zeros(len(deviations)), self.covariance()).logpdf(deviations))

    def log_density_with_outliers(self, deviations: np.ndarray, share: float, factor: float) -> tuple[float, Array]:
        """Over all choices of outliers among the detections, and the probability (2 K,) of each to be one."""
        added = (factor - 1.0) * np.tile(np.array([SIGMA_RANGE, SIGMA_BEARING]) ** 2, 2 * KEYFRAMES)
        choices = np.array(list(product((0, 1), repeat=2 * KEYFRAMES)))
        spreads = self.covariance() + np.repeat(choices, 2, axis=1)[:, :, None] * np.diag(added)
        squared = np.linalg.solve(spreads, np.broadcast_to(deviations, (len(choices), len(deviations)))[..., None])
        logs = -0.5 * (squared[..., 0] @ deviations) - 0.5 * np.linalg.slogdet(2.0 * np.pi * spreads)[1]
        logs += choices.sum(axis=1) * np.log(share) + (1 - choices).sum(axis=1) * np.log1p(-share)
        total = float(np.logaddexp.reduce(logs))
        return total, np.exp(logs - total) @ choices

    def objects_after(self) -> np.ndarray:
        """(4, 4) covariance of both objects given all measurements."""
        prior = np.diag(self.prior**2)
        cross = prior @ self.slopes.T
        return (prior - cross @ np.linalg.solve(self.covariance(), cross.T))[-4:, -4:]


def drive(share: float, deviations: np.ndarray, others: dict[str, float] | None = None) -> tuple[Engine, float]:
    """The engine after the drive, and log P(Z) up to what does not depend on the share."""
    start = np.diag([START, START, START]) ** 2
    sigmas = {"sigma_m": SIGMA_OBJECT, "sigma_rad": 1.0}
    prior = MapPrior(tuple(ObjectPrior.planar(n, *point, **sigmas) for n, point in enumerate(TWINS.tolist())))
    settings = configuration({**ERRORS, "correlated_share": share, **(others or {})})
    engine = Engine(settings, prior, initial_pose=np.zeros(3), initial_covariance=start)
    covariance = np.diag([SIGMA_RANGE, SIGMA_BEARING]) ** 2
    for k, robot in enumerate(robots()):
        measured = np.array([seen_from(robot, point) for point in TWINS]) + deviations.reshape(-1, 2, 2)[k]
        detections = [Detection(range_m=r, bearing_rad=b, covariance=covariance) for r, b in measured]
        engine.process(Keyframe.planar(k, motion=MOTION, detections=detections, motion_sigmas=(STEP_SIGMA,) * 3))
    return engine, engine.log_evidence


def test_the_evidence_is_that_of_the_joint_gaussian_of_two_objects_in_every_frame() -> None:
    repeating, white = JointGaussian(0.9), JointGaussian(0.0)
    deviations = repeating.deviations()
    expected = repeating.log_density(deviations) - white.log_density(deviations)
    assert expected > 3.0
    found = drive(0.9, deviations)[1] - drive(0.0, deviations)[1]
    assert found == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("share", [0.9, 1e-4, 1e-12, 5e-324])
def test_what_the_sensor_always_gets_wrong_is_that_of_the_joint_gaussian(share: float) -> None:
    plain, world = JointGaussian(share), JointGaussian(share, SENSOR)
    without, deviations = plain.deviations(), world.deviations()
    engine, log_evidence = drive(share, deviations, SENSOR)
    expected = world.log_density(deviations) - plain.log_density(without)
    assert log_evidence - drive(share, without)[1] == pytest.approx(expected, abs=0.03)
    mean, sigma = world.sensor_after(deviations)
    tracked = next(iter(engine.pool._backends[0].held.values())).component.tracked
    np.testing.assert_allclose(tracked.sensor[:, 1], sigma, rtol=0.02)
    np.testing.assert_allclose(tracked.sensor[:, 0], mean, atol=0.05 * sigma.max())
    assert sigma.max() < 0.5


def at_rest(share: float, exact: float) -> HybridBelief:
    """Of a robot that misses one of two things now and then; noise is smaller than usual by a factor ``exact``."""
    errors = {"correlated_share": share, "sigma_yaw_rad": 0.03, "sigma_range_offset_m": 0.05}
    settings = replace(configuration(errors, field_of_view_rad=3.0), association="given")
    engine = Engine(settings, initial_pose=np.zeros(3), initial_covariance=np.diag([0.013, 0.013, 0.0046]) ** 2)
    places, random = {"a": (2.3, 0.05), "b": (4.4, -0.03)}, np.random.default_rng(3)
    sigmas = np.array([0.04, 0.01]) / exact
    for k, seen in enumerate(["ab", "a", "ab", "b", "ab", "a", "ab"]):
        detections = []
        for name in seen:
            reach, bearing = places[name] + sigmas * random.normal(size=2)
            detections.append(
                Detection(range_m=reach, bearing_rad=bearing, track_id=name, covariance=np.diag(sigmas) ** 2)
            )
        belief = engine.process(Keyframe.planar(k, detections=detections, motion_sigmas=(0.01, 0.01, 0.01)))
    return belief


@pytest.mark.parametrize("exact", [1.0, 50.0])
@pytest.mark.parametrize("share", [1e-2, 1e-4, 1e-9, 1e-300])
def test_constant_errors_are_told_from_those_that_repeat_however_little_that_is(share: float, exact: float) -> None:
    """To what a share of a thousandth changes, which may be more for sensors that are very exact."""
    found, expected = at_rest(share, exact), at_rest(1e-3, exact)
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-4)
    np.testing.assert_allclose(found.object_poses, expected.object_poses, atol=2e-3)
    np.testing.assert_allclose(found.noise_values, expected.noise_values, atol=2e-4)
    np.testing.assert_allclose(found.noise_sigmas, expected.noise_sigmas, rtol=0.01)


@pytest.mark.parametrize("share", [0.9, 0.0])
def test_the_evidence_is_that_of_all_choices_of_outliers_where_these_are_clear(share: float) -> None:
    """But for what an earlier choice that was made would gain from later detections."""
    world = JointGaussian(share)
    plain = world.deviations()
    jumping = plain.copy()
    jumping[12] += 8.0 * SIGMA_RANGE  # the first twin in keyframe 3
    expected, probability = world.log_density_with_outliers(jumping, 0.03, 16.0)
    told = {"outlier_share": 0.03, "outlier_counts": 1e9, "outlier_factor": 16.0}
    _, log_evidence = drive(share, jumping, told)
    assert log_evidence - drive(share, plain)[1] == pytest.approx(expected - world.log_density(plain), abs=0.1)
    assert probability[6] > 0.999


@pytest.mark.parametrize("share", [0.9, 0.0])
def test_objects_are_known_as_well_as_the_joint_gaussian_has_them(share: float) -> None:
    world = JointGaussian(share)
    engine, _ = drive(share, world.deviations())
    component = next(iter(engine.pool._backends[0].held.values())).component
    found = component.joint_covariance([object_key(0), object_key(1)])
    rows = [0, 1, 3, 4]
    np.testing.assert_allclose(found[np.ix_(rows, rows)], world.objects_after(), rtol=0.02, atol=2e-10)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.9, 0.0])
def test_a_robot_at_rest_learns_of_a_place_no_more_than_what_repeats_lets_it(share: float) -> None:
    engine = Engine(configuration({"correlated_share": share}), initial_covariance=np.diag([1e-8] * 3))
    detection = Detection(range_m=2.0, bearing_rad=0.0, covariance=np.diag([0.1, 0.05]) ** 2)
    along = []
    for k in range(40):
        belief = engine.process(Keyframe.planar(k, detections=[detection], motion_sigmas=(1e-5,) * 3))
        assert len(belief.object_ids) == 1
        along.append(planar_from_covariance(belief.object_covariances[0])[0, 0] / 0.1**2)
    np.testing.assert_allclose(along, share + (1.0 - share) / np.arange(1, 41), rtol=0.02)


@pytest.mark.long
@pytest.mark.slow
def test_a_lineage_is_rebuilt_with_its_errors() -> None:
    errors = {**ERRORS, "sigma_range_offset_m": 0.05, "sigma_yaw_rad": 0.03}
    room = make_room(14, 0, clutter=0.05, detection_errors=errors, open_world={"iterate_updates": False})
    whole = Engine.of_run(room.run, InProcessPool(2))
    divided = Engine.of_run(room.run, ForgetfulPool(2))
    for keyframe in room.keyframes:
        assert_same(divided.process(keyframe), whole.process(keyframe))


def test_only_single_steps_know_of_them() -> None:
    with pytest.raises(InputError, match="iterate_updates"):
        make_room(1, detection_errors=ERRORS)


def test_what_a_sensor_always_gets_wrong_needs_errors_that_repeat() -> None:
    with pytest.raises(InputError, match="sigma_yaw_rad need"):
        make_room(1, detection_errors={"sigma_yaw_rad": 0.03}, open_world={"iterate_updates": False})


@pytest.mark.long
@pytest.mark.parametrize("seen", ["ab", "a", "a b", "ab b", "a b  ab"])
def test_a_robot_at_rest_learns_a_place_no_better_though_frames_miss_it(seen: str) -> None:
    """What every few frames see, over and over: words of names, one for each frame."""
    places, sigmas = {"a": (2.0, 0.6), "b": (3.5, -0.8)}, np.array([0.1, 0.05])
    settings = configuration({"correlated_share": 0.9}, field_of_view_rad=3.0)
    known = replace(settings, association="given")
    engine = Engine(known, initial_pose=np.zeros(3), initial_covariance=1e-8 * np.eye(3))
    frames = seen.split(" ")
    for k in range(40):
        names = frames[k % len(frames)]
        found = [
            Detection(range_m=r, bearing_rad=b, covariance=np.diag(sigmas**2), track_id=name)
            for name, (r, b) in places.items()
            if name in names
        ]
        belief = engine.process(Keyframe.planar(k, detections=found, motion_sigmas=(1e-6,) * 3))
    along = np.array([np.cos(places["a"][1]), np.sin(places["a"][1])])
    covariance = planar_from_covariance(belief.object_covariances[belief.object_names.index("a")])[:2, :2]
    assert along @ covariance @ along / sigmas[0] ** 2 == pytest.approx(0.9, rel=0.02)
