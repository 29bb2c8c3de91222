"""Classification under an uncertain track: samples that live on between the views, their weights, their replacement."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from worlds.exact.dense_classification import Dense, problem

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.localisation import (
    EvidencePerClass,
    EvidenceTracks,
    GeometricTracks,
    SampledTracks,
    replayed,
)
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.classification.resampling import rejection_control, systematic_resampling
from semantic_slam.classification.track_posterior import GaussianTrack

ODOMETRY_SIGMA_M = 0.4


def odometry(num_views: int) -> np.ndarray:
    """(2 K, 2 K) covariance of a random walk from an uncertain start."""
    steps = 1.0 + np.minimum.outer(np.arange(num_views), np.arange(num_views))
    return np.kron(ODOMETRY_SIGMA_M**2 * steps, np.eye(2))


def belief(locations: np.ndarray, k: int, fixes: tuple[int, ...]) -> GaussianTrack:
    """After view k: odometry, and position fixes of 0.2 m at some views that put the camera half a metre elsewhere."""
    mean, covariance = locations[: k + 1], odometry(k + 1)
    for rows in (slice(2 * fix, 2 * fix + 2) for fix in fixes if fix <= k):
        gain = covariance[:, rows] @ np.linalg.inv(covariance[rows, rows] + 0.04 * np.eye(2))
        mean = mean + (gain @ np.array([0.3, -0.4])).reshape(-1, 2)
        covariance = covariance - gain @ covariance[rows]
    return GaussianTrack(mean, covariance)


def test_gaussian_track_extends_and_weighs_as_its_moments_say() -> None:
    generator = np.random.default_rng(0)
    mean, covariance = generator.normal(size=(4, 2)), odometry(4)
    track = GaussianTrack(mean, covariance)
    given = track.sample(1, generator)[:, :3]
    drawn = track.extend(np.repeat(given, 20000, axis=0), generator)
    np.testing.assert_allclose(drawn.mean(axis=0), mean[3] + given[0, 2] - mean[2], atol=0.02)  # it is a random walk
    np.testing.assert_allclose(np.cov(drawn.T), ODOMETRY_SIGMA_M**2 * np.eye(2), atol=0.01)
    tracks = generator.normal(size=(5, 3, 2))
    exact = multivariate_normal(mean[:3].ravel(), covariance[:6, :6]).logpdf(tracks.reshape(5, 6))
    np.testing.assert_allclose(np.diff(track.log_density(tracks)), np.diff(exact), atol=1e-5)


def test_tracks_that_share_one_offset_stay_together() -> None:
    generator = np.random.default_rng(1)
    mean = np.arange(8.0).reshape(4, 2)
    track = GaussianTrack(mean, np.tile(4.0 * np.eye(2), (4, 4)))
    tracks = track.sample(100, generator)[:, :3]
    offsets = track.extend(tracks, generator) - mean[3]
    np.testing.assert_allclose(offsets, tracks[:, 0] - mean[0], atol=1e-3)


def test_nothing_is_replaced_while_the_belief_of_the_past_stays() -> None:
    processes, log_prior, scores, locations = _parts(seed=3, num_views=6)
    method = GeometricTracks(RecursiveClassifier(processes, log_prior), 50, np.random.default_rng(2))
    for k, measurement in enumerate(scores):
        found = method.update(measurement, GaussianTrack(locations[: k + 1], odometry(k + 1)))
    np.testing.assert_allclose(method.log_weights, -np.log(50))
    assert method.replaced == 0
    again = replayed(method.classifier, scores, method.tracks_m)
    np.testing.assert_allclose(np.logaddexp.reduce(again.log_posteriors) - np.log(50), found, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("make, fixes", [(GeometricTracks, (2, 6)), (EvidenceTracks, (2, 6)), (EvidenceTracks, ())])
def test_incremental_equals_fresh_samples_of_the_last_posterior(make: type[SampledTracks], fixes: tuple) -> None:
    """Position fixes along the way change what is believed of the whole track."""
    processes, log_prior, scores, locations = _parts(seed=11, num_views=8)
    method = make(JointClassifier(processes, log_prior), 2000, np.random.default_rng(3))
    for k, measurement in enumerate(scores):
        posterior = belief(locations, k, fixes)
        found = method.update(measurement, posterior)
    assert 0 < method.replaced <= 2 * 2000 if fixes else method.replaced == 0
    batch = replayed(method.classifier, scores, posterior.sample(20000, np.random.default_rng(4)))
    logs = batch.log_evidence if isinstance(method, EvidenceTracks) else np.zeros(20000)
    weights = np.exp(logs - logs.max())
    expected = weights @ np.exp(batch.log_posteriors) / weights.sum()
    np.testing.assert_allclose(np.exp(found), expected, atol=0.04)
    if isinstance(method, EvidenceTracks):
        assert abs(method.log_evidence - np.log(weights.mean()) - logs.max()) < 0.2


def test_evidence_average_is_the_mixture_of_the_joint_likelihoods() -> None:
    """Sum over tracks of p(z | track, c) p(c), normalised once at the end; nothing resampled."""
    given = problem("plain", "sigma_n", seed=12)
    processes, log_prior, scores, locations = _parts(seed=12)
    method = EvidenceTracks(JointClassifier(processes, log_prior), 6, np.random.default_rng(5), least_share=0.0)
    for k, measurement in enumerate(scores):
        found = method.update(measurement, belief(locations, k, ()))
    logs = []
    for track in method.tracks_m:
        dense, row = Dense(given, track), []
        for c in range(len(log_prior)):
            mean, cov = dense.stacked(c, slice(0, len(track)))
            density = multivariate_normal(mean, cov + dense.noise(slice(0, len(track))))
            row.append(density.logpdf(dense.mu.ravel()) + log_prior[c])
        logs.append(row)
    expected = np.logaddexp.reduce(logs)
    np.testing.assert_allclose(found, expected - np.logaddexp.reduce(expected), atol=1e-8)
    np.testing.assert_allclose(method.log_evidence, np.logaddexp.reduce(expected) - np.log(6), atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("rigid", [False, True])
def test_evidence_of_each_class_over_tracks_of_its_own(rigid: bool) -> None:
    """Against the plain average of p(z | track, c) over many tracks; rigid: one offset, copies have to be moved."""
    processes, log_prior, scores, locations = _parts(seed=12, num_views=6)
    covariance = 0.25 * np.kron(np.ones((6, 6)) if rigid else np.eye(6), np.eye(2))
    joint = JointClassifier(processes, log_prior)
    generator = np.random.default_rng(8)
    filters = [EvidenceTracks(joint.of_class(c), 1000, generator, move=rigid) for c in range(2)]
    method = EvidencePerClass(filters, log_prior)
    for k, measurement in enumerate(scores):
        size = 2 * (k + 1)
        found = method.update(measurement, GaussianTrack(locations[: k + 1], covariance[:size, :size]))
    assert all(tracks.moved > 0 for tracks in filters) == rigid
    tracks = GaussianTrack(locations, covariance).sample(20000, generator)
    for c, own in enumerate(filters):
        logs = replayed(joint.of_class(c), scores, tracks).log_evidence
        exact = np.logaddexp.reduce(logs) - np.log(len(logs))
        assert abs(own.log_evidence - exact) < 0.3
    expected = log_prior + [tracks.log_evidence for tracks in filters]
    np.testing.assert_allclose(found, expected - np.logaddexp.reduce(expected))


def test_evidence_of_each_class_follows_a_loop_closure_that_redraws_no_track() -> None:
    """The second view moves the first one over to where the other class explains its score.

    Against the plain average of p(z | track, c) over many tracks of the last posterior.
    """
    score = Scores(np.array([[0.6]]), np.array([0.6]), np.zeros((1, 1)))
    places = np.stack([np.linspace(-2.0, 2.0, 5), np.zeros(5)], axis=1)
    slopes = [np.array([1.0, 1.0, 0.0, -1.0, -1.0]), np.array([-1.0, -1.0, 0.0, 1.0, 1.0])]
    models = [ClassModel(places, own[:, None], np.ones(1), np.eye(2)[None], np.array([0.2])) for own in slopes]
    log_prior = np.log([0.5, 0.5])
    joint = JointClassifier(ClassProcesses(models), log_prior)
    generator = np.random.default_rng(0)
    method = EvidencePerClass([EvidenceTracks(joint.of_class(c), 20000, generator) for c in range(2)], log_prior)
    method.update(score, GaussianTrack(np.array([[-0.3, 0.0]]), 0.5 * np.eye(2)))
    after = GaussianTrack(np.array([[0.3, 0.0], [0.3, 0.0]]), np.diag([0.3, 0.3, 4.0, 4.0]))
    found = method.update(score, after)
    tracks = after.sample(100000, np.random.default_rng(1))
    logs = [replayed(joint.of_class(c), [score, score], tracks).log_evidence for c in range(2)]
    exact = np.logaddexp.reduce(logs, axis=1) - np.log(len(tracks))
    assert all(own.replaced == 0 for own in method.of_classes)
    np.testing.assert_allclose([own.log_evidence for own in method.of_classes], exact, atol=0.03)
    np.testing.assert_allclose(np.exp(found), np.exp(exact) / np.exp(exact).sum(), atol=0.01)


def test_moves_leave_the_posterior_as_it_is() -> None:
    generator = np.random.default_rng(9)
    mean, covariance = generator.normal(size=(3, 2)), odometry(3)
    track = GaussianTrack(mean, covariance)
    moved = track.move(track.sample(20000, generator), generator.random(20000), generator).reshape(20000, 6)
    np.testing.assert_allclose(moved.mean(axis=0), mean.ravel(), atol=0.03)
    np.testing.assert_allclose(np.cov(moved.T), covariance, atol=0.03)


def test_systematic_resampling_copies_by_weight() -> None:
    lost, copied = systematic_resampling(np.log([0.5, 0.25, 0.0625, 0.1875]), np.random.default_rng(7))
    assert len(lost) == len(copied)
    offspring = np.ones(4) - np.isin(np.arange(4), lost) + np.bincount(copied, minlength=4)
    np.testing.assert_allclose(offspring[:2], [2, 1])
    assert offspring.sum() == 4


def test_rejection_control_changes_no_average() -> None:
    """Draws of N(0, 1) weighed for N(1, 1): the average of x stays 1 once light draws have given way to fresh ones."""
    generator = np.random.default_rng(6)
    averages = []
    for _ in range(500):
        drawn = generator.normal(size=1000)
        logs = drawn - 0.5  # log N(x; 1, 1) - log N(x; 0, 1)
        logs -= np.logaddexp.reduce(logs)
        fresh, log_weights = rejection_control(logs, generator)
        drawn[fresh] = generator.normal(1.0, 1.0, len(fresh))
        weights = np.exp(log_weights)
        np.testing.assert_allclose(weights.sum(), 1.0)
        averages.append(weights @ drawn)
    assert abs(np.mean(averages) - 1.0) < 0.01
    assert np.std(averages) < 0.05


def _parts(seed: int, num_views: int = 6) -> tuple[ClassProcesses, np.ndarray, list[Scores], np.ndarray]:
    given = problem("plain", "sigma_n", seed, num_views)
    processes = ClassProcesses([ClassModel.from_json(row) for row in given["classes"]])
    columns = zip(given["samples"], given["mu_z"], given["Sigma_z"], strict=True)
    scores = [Scores(np.array(z), np.array(mu), np.array(s)) for z, mu, s in columns]
    return processes, np.log(given["prior"]), scores, np.array(given["X"])
