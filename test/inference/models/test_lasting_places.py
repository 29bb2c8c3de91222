"""Errors of detections that repeat, against the covariance over true places: a robot at rest, and one that drives."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.correlated_errors import (
    LEAST_LEFT,
    MOST_UNSEEN,
    ErrorTransition,
    lasting_places,
)
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.states.propagated_errors import PropagatedErrors

OBJECTS = np.array([[5.0, 0.0], [5.5, 1.2], [6.5, -1.4]])
DRIVES = 5


def detected(polar: Array, sigma_m: float, has_range: bool = True) -> PlanarDetection:
    """At range [m] and bearing [rad], with errors of ``sigma_m`` along and across at 5 m."""
    return PlanarDetection(
        range_m=float(polar[0]) if has_range else np.nan,
        bearing_rad=float(polar[1]),
        covariance=np.diag([sigma_m, sigma_m / 5.0]) ** 2,
        sensor=np.zeros(2),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )


def polar_of(places: Array) -> Array:
    return np.stack([np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])], axis=1)


def points_of(polar: Array) -> Array:
    return polar[:, :1] * np.stack([np.cos(polar[:, 1]), np.sin(polar[:, 1])], axis=1)


@dataclass
class Chain:
    """Covariance of the repeated errors of all frames so far."""

    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    newest: int = 0

    def extend(self, matrix: Array, noise: Array) -> None:
        before = self.covariance[len(self.covariance) - self.newest :]
        cross = matrix @ before
        own = cross[:, len(self.covariance) - self.newest :] @ matrix.T + noise
        self.covariance = np.block([[self.covariance, cross.T], [cross, own]])
        self.newest = len(own)


@dataclass
class Drive:
    """Objects that stand still, seen again and again ``step_m`` further on; n detections in all, with errors drawn.

    Covariances (2 n, 2 n) are of whole whitened errors.
    """

    share: float
    sigma_m: float
    step_m: float
    objects: Array
    seed: int
    num_frames: int = 50

    def __post_init__(self) -> None:
        self.settings = DetectionErrorsConfiguration(correlated_share=self.share)
        self.control = np.array([self.step_m, 0.0, 0.0])
        self.left = float(np.exp(-self.step_m / self.settings.motion_m))
        random = np.random.default_rng(self.seed)
        over_frames = self.left ** np.abs(np.subtract.outer(np.arange(self.num_frames), np.arange(self.num_frames)))
        self.true = self._whole(np.kron(over_frames, self._kernel(self.objects, self.objects)))
        size = (self.num_frames, len(self.objects), 2)
        errors = np.linalg.cholesky(self.true) @ random.standard_normal(len(self.true))
        travelled = self.step_m * np.arange(self.num_frames)
        seen = self.objects + np.stack([6.0 - travelled, 0.0 * travelled], axis=1)[:, None] * (self.step_m > 0.0)
        polar = np.array([polar_of(own) for own in seen])
        self.polar = polar + errors.reshape(size) * np.array([self.sigma_m, self.sigma_m / 5.0])

    def _kernel(self, one: Array, other: Array) -> Array:
        near = np.exp(-0.5 * ((one[:, None] - other[None]) ** 2).sum(axis=-1) / self.settings.neighbour_m**2)
        common = np.array([self.settings.common_range_share, self.settings.common_bearing_share])
        shared = common[:, None, None] + (1.0 - common[:, None, None]) * near
        return np.einsum("cij,cd->icjd", shared, np.eye(2)).reshape(2 * len(one), 2 * len(other))

    def _whole(self, repeated: Array) -> Array:
        return self.share * repeated + (1.0 - self.share) * np.eye(len(repeated))

    def found(self, is_seen: Array | None = None) -> Array:
        """The covariance by the transitions from frame to frame; ``is_seen`` (frames, objects): all are if None."""
        chain, carried, rows = Chain(), None, list[int]()
        for k, polar in enumerate(self.polar):
            carried = None if carried is None else carried.moved(self.control, self.settings)
            seen = [detected(own, self.sigma_m) for own in (polar if is_seen is None else polar[is_seen[k]])]
            if seen:
                step = ErrorTransition.of(self.settings, carried, seen)
                rows += range(len(chain.covariance), len(chain.covariance) + 2 * len(seen))
                chain.extend(step.matrix, step.noise)
                carried = step.after(k, np.zeros(len(step.mean)))
        return self._whole(chain.covariance[np.ix_(rows, rows)])

    def over_measured_places(self) -> Array:
        """The covariance if the kernel is evaluated at measured places."""
        chain, before = Chain(), None
        for polar in self.polar:
            places = points_of(polar)
            own = self._kernel(places, places) + 1e-9 * np.eye(2 * len(places))
            matrix, noise = np.zeros((len(own), 0)), own
            if before is not None:
                cross = self.left * self._kernel(places, before)
                known = self._kernel(before, before) + 1e-9 * np.eye(2 * len(before))
                matrix = np.linalg.solve(known, cross.T).T
                noise = own - matrix @ cross.T
            chain.extend(matrix, noise)
            before = places - self.control[:2]
        return self._whole(chain.covariance)

    def divergence(self, other: Array) -> float:
        """Kullback-Leibler divergence [nats] of another zero-mean Gaussian from the true one."""
        ratio = np.linalg.solve(other, self.true)
        return float(0.5 * (np.trace(ratio) - len(ratio) - np.linalg.slogdet(ratio)[1]))


@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("sigma_m", [0.05, 0.2])
def test_a_robot_at_rest_does_not_forget_what_repeats_however_noisy_places_are(share: float, sigma_m: float) -> None:
    """But for a drive in eighty, in which some place is measured four standard deviations from the first one."""
    left = []
    for seed in range(DRIVES):
        drive = Drive(share, sigma_m, 0.0, OBJECTS[:1], seed)
        every = np.tile(np.eye(2), (drive.num_frames, 1))
        left.append(np.linalg.inv(every.T @ np.linalg.solve(drive.found(), every)))
    expected = (share + (1.0 - share) / drive.num_frames) * np.eye(2)
    np.testing.assert_allclose(np.median(left, axis=0), expected, rtol=0.03, atol=1e-9)


@pytest.mark.parametrize("step_m", [0.0, 0.1, 0.25, 0.5])
@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("sigma_m", [0.05, 0.2])
def test_errors_of_a_drive_are_nearer_to_those_over_true_places_than_over_measured_ones(
    step_m: float, share: float, sigma_m: float
) -> None:
    found, measured = [], []
    for seed in range(DRIVES):
        drive = Drive(share, sigma_m, step_m, OBJECTS, seed, num_frames=20)
        found.append(drive.divergence(drive.found()))
        measured.append(drive.divergence(drive.over_measured_places()))
    assert np.mean(found) < 0.7 * np.mean(measured)


def carried(places: Array, left: float = 1.0) -> PropagatedErrors:
    return PropagatedErrors(
        keyframe=0,
        places=places,
        by_sensor=np.zeros((2 * len(places), 0)),
        left_of_each=np.ones(len(places)),
        mean=np.zeros(2 * len(places)),
        left=left,
    )


def test_places_are_kept_one_to_one_in_any_order() -> None:
    settings, before = DetectionErrorsConfiguration(correlated_share=0.5), points_of(np.array([[3.0, 0.1], [4.0, 0.4]]))
    seen = [detected(np.array(own), 0.1) for own in ([4.05, 0.41], [3.1, 0.09], [3.15, 0.1])]
    found, unseen = lasting_places(settings, carried(before), seen)
    assert not unseen.size
    np.testing.assert_allclose(found[:2], before[::-1])
    np.testing.assert_allclose(found[2], seen[2].place)


def test_what_is_elsewhere_has_a_place_of_its_own() -> None:
    settings, before = DetectionErrorsConfiguration(correlated_share=0.5), points_of(np.array([[3.0, 0.1]]))
    for seen in (detected(np.array([3.5, 0.1]), 0.1), detected(np.array([3.0, 0.1]), 0.1, has_range=False)):
        found, unseen = lasting_places(settings, carried(before), [seen])
        np.testing.assert_allclose(found, [seen.place])
        assert unseen.tolist() == [0]


def test_places_are_measured_anew_as_errors_are_after_a_motion() -> None:
    settings, before = DetectionErrorsConfiguration(correlated_share=0.5), points_of(np.array([[3.0, 0.1]]))
    seen = detected(np.array([3.1, 0.09]), 0.1)
    for left in (1.0, 0.4, 0.0):
        found, _ = lasting_places(settings, carried(before, left), [seen])
        np.testing.assert_allclose(found, left * before + (1.0 - left) * seen.place[None])


@pytest.mark.parametrize("step_m", [0.0, 0.1])
def test_errors_are_those_over_all_frames_though_every_frame_misses_half_of_what_is_there(step_m: float) -> None:
    """With places measured to a millimetre, whose kernel is the true one."""
    drive = Drive(0.9, 1e-3, step_m, OBJECTS, seed=4, num_frames=30)
    is_seen = np.random.default_rng(0).random((drive.num_frames, len(OBJECTS))) < 0.5
    true = drive.true[np.ix_(*[np.flatnonzero(np.repeat(is_seen.ravel(), 2))] * 2)]
    np.testing.assert_allclose(drive.found(is_seen), true, atol=0.02)


def test_the_places_seen_last_are_carried_and_none_for_ever() -> None:
    settings = DetectionErrorsConfiguration(correlated_share=0.5)
    rows = np.array([[1.0 + 0.5 * n, 0.0] for n in range(MOST_UNSEEN + 3)])
    far = [detected(np.array([30.0, 0.5]), 0.1)]
    step = ErrorTransition.of(settings, carried(rows), far)
    np.testing.assert_allclose(step.places[1:], rows[:MOST_UNSEEN])
    after = step.after(1, np.zeros(len(step.mean)))
    driven = after.moved(np.array([-settings.motion_m * np.log(LEAST_LEFT) + 0.1, 0.0, 0.0]), settings)
    assert len(ErrorTransition.of(settings, driven, far).places) == 1
