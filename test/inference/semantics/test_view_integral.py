"""Views of objects whose descriptors are hardly known, against closed forms and large importance samples."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal, multivariate_t
from worlds.views.harmonic_model import HarmonicModel
from worlds.views.latent_toy import toy_model

import semantic_slam
from semantic_slam.inference.evidence.laplace import find_modes
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.semantics.descriptors import heading_update
from semantic_slam.inference.semantics.descriptors.descriptor_posterior import integrated
from semantic_slam.inference.semantics.descriptors.descriptor_problem import DescriptorProblem
from semantic_slam.inference.semantics.descriptors.descriptor_views import best_mode, posterior
from semantic_slam.inference.semantics.descriptors.heading_update import DirectionalView, updated_mixtures
from semantic_slam.inference.semantics.descriptors.view_integral import ViewIntegral, fixed_points, share_of_integral
from semantic_slam.inference.states.heading_mixture import HeadingMixture
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorBelief
from semantic_slam.latent.store import read_latent_model
from semantic_slam.viewpoint.model import Viewpoints

SHIPPED = read_latent_model(Path(semantic_slam.__file__).parent / "weights" / "latent_model.safetensors")
TEMPERING = 2.0
HEADING, ELEVATION = 0.4, 0.3
NARROW = 1e-3


def seen_from(model: LatentModel, azimuths: np.ndarray, seed: int) -> DetectionFeatures:
    """Features of one view of another object from each azimuth."""
    random, count = np.random.default_rng(seed), len(azimuths)
    descriptors = model.instances.descriptors[random.integers(len(model.instances.names), size=count)]
    mean = model.mean(Viewpoints(azimuths, np.full(count, ELEVATION), np.ones(count)), descriptors)
    return features_of(mean + model.noise.tempered * random.normal(size=mean.shape))


def features_of(features: np.ndarray) -> DetectionFeatures:
    return DetectionFeatures(
        feature=features,
        variance=np.zeros_like(features),
        sensor=np.zeros((len(features), 2)),
        elevation_rad=np.full(len(features), ELEVATION),
    )


def log_likelihood(
    model: LatentModel, feature: np.ndarray, azimuth: np.ndarray, e: np.ndarray, tempering: float = TEMPERING
) -> np.ndarray:
    mean = model.mean(Viewpoints(azimuth, np.full(len(e), ELEVATION), np.ones(len(e))), e)
    sigma = model.noise.tempered
    log = -0.5 * (((feature - mean) / sigma) ** 2).sum(axis=1) - np.log(sigma * np.sqrt(2 * np.pi)).sum()
    return np.asarray(log / tempering)


def sampled(log_joint, centre: np.ndarray, covariance: np.ndarray, count: int = 20_000) -> tuple[float, np.ndarray]:
    """Log integral by importance samples of Student's t, fitted once; the weights and points come with it."""
    random = np.random.default_rng(0)
    for _ in range(2):
        proposal = multivariate_t(centre, covariance, df=8, seed=random)
        points = proposal.rvs(count)
        log_weight = log_joint(points) - proposal.logpdf(points)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        centre, covariance = weight @ points, np.cov(points.T, aweights=weight)
    return float(np.logaddexp.reduce(log_weight) - np.log(count)), np.stack([centre, np.sqrt(np.diag(covariance))])


def exact(model: LatentModel, belief: DescriptorBelief, seen: DetectionFeatures, azimuth: float):
    """Log evidence of one view from a known direction, and the descriptor's means and standard deviations after it."""
    prior = multivariate_normal(belief.mean[0], np.diag(belief.sigma[0] ** 2))

    def log_joint(e: np.ndarray) -> np.ndarray:
        return log_likelihood(model, seen.feature[0], np.full(len(e), azimuth), e) + prior.logpdf(e)

    return sampled(log_joint, belief.mean[0], 0.8**2 * np.diag(belief.sigma[0] ** 2))


def viewed(model: LatentModel, belief: DescriptorBelief, seen: DetectionFeatures, azimuth: float):
    """The modes after one view of an object of known heading, and the view's log evidence."""
    modes = HeadingMixture.about(belief, HEADING, NARROW)
    view = DirectionalView(modes=modes, view=0, bearing_rad=azimuth + HEADING, sigma_rad=NARROW)
    ((after, evidence),) = updated_mixtures(LatentObservation(model, TEMPERING), seen, [view])
    return after, evidence


@pytest.mark.parametrize("seed", range(4))
def test_a_first_view_weighs_its_integral(seed: int) -> None:
    """Laplace's evidence is one to two nats low, and its standard deviations are 0.8 to 0.9 of the exact ones."""
    azimuth = 1.3 * seed - 2.0
    seen = seen_from(SHIPPED, np.array([azimuth]), seed)
    evidence, (mean, sigma) = exact(SHIPPED, SHIPPED.prior, seen, azimuth)
    after, found = viewed(SHIPPED, SHIPPED.prior, seen, azimuth)
    assert found == pytest.approx(evidence, abs=0.3)
    means, variances = after.descriptor()
    assert np.mean(np.sqrt(variances) / sigma) == pytest.approx(1.0, abs=0.08)
    assert np.sqrt(np.mean(((means - mean) / sigma) ** 2)) < 0.25


@pytest.mark.parametrize("seed", range(3))
def test_whether_a_view_is_of_a_known_or_a_new_object(seed: int) -> None:
    """The log odds of an object whose descriptor is known against one that was never seen are the exact ones."""
    azimuth = 0.9 * seed + 0.2
    seen = seen_from(SHIPPED, np.array([azimuth]), 10 + seed)
    near = SHIPPED.instances.descriptors[seed][None]
    known = DescriptorBelief(near, 0.1 * SHIPPED.prior.sigma)
    true, found = (
        [way(SHIPPED, belief, seen, azimuth) for belief in (known, SHIPPED.prior)] for way in (exact, viewed)
    )
    odds = [true[0][0] - true[1][0], found[0][1] - found[1][1]]
    assert odds[1] == pytest.approx(odds[0], abs=0.35)


def test_a_view_of_a_known_descriptor_is_that_of_laplace_to_the_bit() -> None:
    """The integral costs nothing where descriptors are known."""
    assert not share_of_integral(np.full((1, 12), 0.39**2) * SHIPPED.prior.sigma**2, SHIPPED.prior.sigma).any()
    belief = DescriptorBelief(SHIPPED.instances.descriptors[:1], 0.35 * SHIPPED.prior.sigma)
    seen = seen_from(SHIPPED, np.array([0.5]), 3)
    after, evidence = viewed(SHIPPED, belief, seen, 0.5)
    problem = heading_update._Directions(
        observation=LatentObservation(SHIPPED, TEMPERING),
        seen=seen,
        mean=np.append(belief.mean[0], HEADING)[None],
        root=np.diag(np.append(belief.sigma[0], NARROW))[None],
        bearing_rad=np.array([0.5 + HEADING]),
        sigma_rad=np.array([NARROW]),
    )
    mode = find_modes(problem, problem.start(), heading_update.MAX_ITERATIONS, heading_update.TOLERANCE)
    assert evidence == mode.log_evidence[0]
    np.testing.assert_array_equal(after.mean, problem.states(mode.y))


def test_evidence_has_no_step_where_descriptors_become_known() -> None:
    """Over slowly narrower priors the log evidence changes slowly, too, up to where the search for the mode ends."""
    seen = seen_from(SHIPPED, np.array([0.5]), 3)
    shares = np.arange(0.40, 0.70, 0.01)
    beliefs = [DescriptorBelief(SHIPPED.instances.descriptors[:1], s * SHIPPED.prior.sigma) for s in shares]
    logs = np.array([viewed(SHIPPED, belief, seen, 0.5)[1] for belief in beliefs])
    assert np.abs(np.diff(logs, n=2)).max() < 0.05


def test_views_do_not_depend_on_what_else_is_in_the_batch() -> None:
    """Not to the last bit: work may be divided among processes in any way."""
    seen = seen_from(SHIPPED, np.linspace(-2.0, 2.0, 5), 4)
    modes = HeadingMixture.all_around(SHIPPED.prior)
    views = [DirectionalView(modes=modes, view=n, bearing_rad=0.3 * n, sigma_rad=0.02) for n in range(5)]
    observation = LatentObservation(SHIPPED, TEMPERING)
    together = updated_mixtures(observation, seen, views)
    for view, (after, evidence) in zip(views, together, strict=True):
        ((alone, own),) = updated_mixtures(observation, seen, [view])
        assert own == evidence
        np.testing.assert_array_equal(alone.mean, after.mean)
        np.testing.assert_array_equal(alone.covariance, after.covariance)


def test_a_linear_view_has_its_closed_form() -> None:
    """Seen from a known direction the features are linear in y: f ~ N(mu, S + J J^T)."""
    model, random = HarmonicModel(noise=0.8), np.random.default_rng(0)
    part = model.predict(Viewpoints(np.array([0.7]), np.array([ELEVATION]), np.ones(1)), np.zeros((1, 3)))
    jacobian = part.by_descriptor[0]
    covariance = jacobian @ jacobian.T + model.noise**2 * np.eye(model.num_features)
    feature = random.multivariate_normal(part.mean[0], covariance)
    gain = np.zeros((1, 4, 3))
    gain[0, :3] = np.eye(3)
    integral = ViewIntegral(
        observation=LatentObservation(model),
        seen=(features_of(feature[None]),),
        turn=np.zeros((1, 1)),
        offset=np.array([[0.0, 0.0, 0.0, 0.7]]),
        gain=gain,
    )
    information = np.eye(3) + jacobian.T @ jacobian / model.noise**2
    mean = np.linalg.solve(information, jacobian.T @ (feature - part.mean[0])) / model.noise**2
    evidence, y, found = integral.at(mean[None] + 0.3, 1.1 * information[None])
    assert evidence[0] == pytest.approx(multivariate_normal(part.mean[0], covariance).logpdf(feature), abs=0.01)
    np.testing.assert_allclose(y[0], mean, atol=1e-9)
    np.testing.assert_allclose(found[0], information, atol=1e-9)


@pytest.mark.parametrize("size", [2, 14, 30])
def test_points_are_balanced(size: int) -> None:
    first, second = fixed_points(size)
    for points in (first, second):
        np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
        np.testing.assert_allclose(points.T @ points / len(points), np.eye(size), atol=1e-9)
    assert len(first) > 2 * size and len(second) >= 6 * size
    assert not np.isin(np.round(first, 9), np.round(second, 9)).any()


def of_two_views(seed: int, slots: list[list[int]]) -> DescriptorProblem:
    """Continuations that give the two detections of a keyframe to the objects in ``slots``: 15 dimensions each."""
    model, random, tangents = toy_model(seed, sigma=0.9), np.random.default_rng(seed), 9
    second = [2.0, 0.5, 0.4] if slots[0][1] == 0 else [1.5, -1.0, 2.0]
    poses = np.array([[0.0, 0.0, 0.0], [2.0, 0.5, 0.4], second])
    azimuths = np.arctan2(-poses[1:, 1], -poses[1:, 0]) - poses[1:, 2]
    spread = np.tile([0.05, 0.05, 0.1], 3)
    gain = np.tile(np.diag(np.concatenate([spread, np.tile(model.prior.sigma[0], 2)])), (len(slots), 1, 1))
    gain[:, :tangents, :tangents] += 0.01 * random.normal(size=(len(slots), tangents, tangents))
    return DescriptorProblem(
        spaces=Spaces.same(PlanarPoses()),
        observation=LatentObservation(model),
        seen=seen_from(model, azimuths, seed),
        active=np.ones((len(slots), 2), dtype=bool),
        slots=np.array(slots),
        mean=np.tile(poses, (len(slots), 1, 1)),
        offset=np.tile(np.concatenate([np.zeros(tangents), np.tile(model.prior.mean[0], 2)]), (len(slots), 1)),
        gain=gain,
    )


def test_a_continuation_does_not_depend_on_what_else_is_in_the_batch() -> None:
    """Bit for bit, in any order: here two of two objects and two of one object that is seen twice."""
    problem = of_two_views(0, slots=[[0, 1], [0, 0], [0, 1], [0, 0]])
    v, mode = best_mode(problem)
    together = integrated(problem, v, mode, posterior(problem, v, mode))
    assert (np.abs(together.log_factor) > 1e-3).all()
    for rows in ([3], [1], [2, 0], [0, 3, 1]):
        part = problem.select(np.array(rows))
        v_part, mode_part = best_mode(part)
        found = integrated(part, v_part, mode_part, posterior(part, v_part, mode_part))
        for name in ("log_factor", "descriptors", "variances", "directions"):
            np.testing.assert_array_equal(getattr(found, name), getattr(together, name)[rows])


@pytest.mark.parametrize("same", [False, True], ids=["two objects", "one object twice"])
@pytest.mark.parametrize("seed", range(2))
def test_two_views_of_a_keyframe_weigh_their_integral(seed: int, same: bool) -> None:
    """Robot, objects and descriptors are jointly uncertain: 15 dimensions."""
    problem = of_two_views(seed, slots=[[0, 0 if same else 1]])
    model, seen, length = problem.observation.model, problem.seen, 3
    v, mode = best_mode(problem)
    after = integrated(problem, v, mode, posterior(problem, v, mode))

    def log_joint(points: np.ndarray) -> np.ndarray:
        many = problem.select(np.zeros(len(points), dtype=int))
        states, e = many.states(points), many.descriptors(points)
        log = multivariate_normal(np.zeros(15)).logpdf(points)
        for number, slot in enumerate(problem.slots[0]):
            away = states[:, 0, :2] - states[:, 1 + slot, :2]
            azimuth = np.arctan2(away[:, 1], away[:, 0]) - states[:, 1 + slot, 2]
            log += log_likelihood(model, seen.feature[number], azimuth, e[:, slot], tempering=1.0)
        return np.asarray(log)

    evidence, moments = sampled(log_joint, v[0], 1.1 * np.linalg.inv(mode.hessian[0]))
    assert mode.log_evidence[0] + after.log_factor[0] == pytest.approx(evidence, abs=0.03)
    np.testing.assert_allclose(
        np.sqrt(after.variances[0, 0]), model.prior.sigma[0] * moments[1, 9 : 9 + length], rtol=0.1
    )
