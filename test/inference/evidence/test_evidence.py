"""Evidence of a candidate: Laplace and samples against closed forms, quadrature and each other."""

import numpy as np
import pytest
from worlds.exact.linear_gaussian import LinearDetection, LinearModel

from semantic_slam.configuration import PruningConfiguration
from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.levenberg_marquardt import LevenbergMarquardt
from semantic_slam.inference.evidence.importance import WIDENED, Gaussians, Samples, adapted, effective_share, proposal
from semantic_slam.inference.evidence.keyframe_problem import (
    Assignments,
    KeyframeProblem,
    PredictedBelief,
)
from semantic_slam.inference.evidence.laplace import find_modes, mode_at
from semantic_slam.inference.evidence.prior_samples import sample_evidence
from semantic_slam.inference.evidence.search_start import search_start
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.pruning import prune, widened
from semantic_slam.inference.states.identity import generator, hypothesis_id
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.viewpoint.parametric import ParametricModel


def linear_stack(objects: list[int]) -> tuple[KeyframeProblem, float]:
    """One robot and two objects on a plane, two detections; and the exact log evidence of their association."""
    random = np.random.default_rng(0)
    root = random.normal(size=(6, 6))
    covariance = root @ root.T + np.eye(6)
    mean = random.normal(size=(3, 2))
    detections = [LinearDetection(random.normal(size=2), np.zeros(2)) for _ in objects]
    noise = np.array([[0.3, 0.1], [0.1, 0.2]])
    model = LinearModel(noise, np.eye(2), np.zeros((0, 2)), np.zeros((0, 2, 2)), 0)
    spaces = Spaces.same(PlanarPositions())
    stack = KeyframeProblem.of(
        spaces,
        model,
        PredictedBelief(spaces.layout, mean[None], covariance[None]),
        model.collect(detections),
        Assignments(parents=np.zeros(1, int), objects=np.array([objects])),
    )
    # z = H s + v with H the rows o_beta - x, so that log p(z) = N(z; H m, H P H^T + R).
    H = np.zeros((4, 6))
    for i, n in enumerate(objects):
        H[2 * i : 2 * i + 2, :2] = -np.eye(2)
        H[2 * i : 2 * i + 2, 2 + 2 * n : 4 + 2 * n] = np.eye(2)
    residual = np.concatenate([z.geo for z in detections]) - H @ mean.ravel()
    total = H @ covariance @ H.T + np.kron(np.eye(2), noise)
    exact = -0.5 * (residual @ np.linalg.solve(total, residual) + np.linalg.slogdet(2 * np.pi * total)[1])
    return stack, float(exact)


@pytest.mark.parametrize("objects", [[0, 1], [1, 0], [1, 1]])
def test_laplace_is_exact_for_linear_models(objects: list[int]) -> None:
    """Also when both detections are of one object."""
    stack, exact = linear_stack(objects)
    mode = find_modes(stack, search_start(stack))
    assert mode.log_evidence[0] == pytest.approx(exact, abs=1e-9)


@pytest.mark.slow
def test_samples_approach_the_closed_form() -> None:
    stack, exact = linear_stack([0, 1])
    log_evidence, effective = sample_evidence(stack, 200_000, [generator(0, "weights", 1, 2)])
    assert log_evidence[0] == pytest.approx(exact, abs=0.05)
    assert 0.0 < effective[0] < 200_000


def planar_stack(covariance: np.ndarray, visibility: PlanarVisibility, semantics: bool = True) -> KeyframeProblem:
    detection = PlanarDetection(
        range_m=2.0,
        bearing_rad=0.1,
        covariance=np.diag([0.01, 0.0025]),
        sensor=np.zeros(2),
        feature=np.array([0.9, 0.1]),
        feature_covariance=np.zeros((2, 2)),
    )
    model = PlanarObservation(ParametricModel(0.5, 15.0) if semantics else None, visibility)
    mean = np.array([[[0.0, 0.0, 0.1], [2.2, 0.1, 1.0]]])
    rows = Assignments(
        parents=np.zeros(1, int),
        objects=np.zeros((1, 1), int),
        classes=np.zeros((1, 1), int) if semantics else None,
    )
    spaces = Spaces.same(PlanarPoses())
    predicted = PredictedBelief(spaces.layout, mean, covariance[None])
    return KeyframeProblem.of(spaces, model, predicted, model.collect([detection]), rows)


@pytest.mark.slow
def test_laplace_agrees_with_many_samples_where_the_posterior_is_narrow() -> None:
    stack = planar_stack(np.diag([0.02, 0.02, 0.01, 0.01, 0.01, 0.01]), PlanarVisibility())
    mode = find_modes(stack, search_start(stack))
    log_evidence, _ = sample_evidence(stack, 300_000, [generator(0, "weights", 1, 2)])
    assert mode.log_evidence[0] == pytest.approx(log_evidence[0], abs=0.02)


def test_a_lost_robot_is_found() -> None:
    """Prior samples hardly meet the mode of a robot lost by 10 m; the damped search starts there."""
    stack = planar_stack(np.diag([100.0, 100.0, 0.04, 0.05, 0.05, 0.0005]), PlanarVisibility(), semantics=False)
    mode = find_modes(stack, search_start(stack))
    assert np.abs(stack.normal_equations(mode.y)[1]).max() < 1e-4
    log_evidence, effective = sample_evidence(stack, 300_000, [generator(0, "weights", 1, 2)])
    assert mode.log_evidence[0] == pytest.approx(log_evidence[0], abs=0.25)  # the heading bends the posterior
    assert effective[0] < 3_000


def test_samples_that_see_nothing_have_no_weight() -> None:
    stack = planar_stack(np.diag([0.02, 0.02, 0.01, 0.01, 0.01, 0.01]), PlanarVisibility(max_range_m=0.1))
    log_evidence, effective = sample_evidence(stack, 1000, [generator(0, "weights", 1, 2)])
    assert log_evidence[0] == -np.inf and effective[0] == 0.0


def test_draws_depend_on_their_key_alone() -> None:
    first = generator(3, "weights", 10, 42).standard_normal(4)
    assert np.array_equal(first, generator(3, "weights", 10, 42).standard_normal(4))
    for other in (generator(4, "weights", 10, 42), generator(3, "x", 10, 42), generator(3, "weights", 11, 42)):
        assert not np.array_equal(first, other.standard_normal(4))


def test_hypothesis_ids_tell_every_part_apart() -> None:
    ids = {
        hypothesis_id(*parts)
        for parts in (
            (1, 2, (3, 4), (0, 1), 0),
            (2, 2, (3, 4), (0, 1), 0),
            (1, 3, (3, 4), (0, 1), 0),
            (1, 2, (4, 3), (0, 1), 0),
            (1, 2, (3, 4), (1, 0), 0),
            (1, 2, (3, 4), (0, 1), 1),
            (1, 2, (3,), (0,), 0),
        )
    }
    assert len(ids) == 7
    assert hypothesis_id(1, 2, (3, 4), (0, 1), 0) == 16494618663731335709


def test_pruning_accounts_for_mass_that_was_never_enumerated() -> None:
    # Masses 6, 3, 1 and 2 never enumerated: keeping the first two of them discards 3 / 12.
    pruned = prune(np.log([6.0, 3.0, 1.0]), np.arange(3, dtype=np.uint64), np.log([2.0]), PruningConfiguration(4.0, 10))
    assert list(pruned.kept) == [0, 1]
    np.testing.assert_allclose(np.exp(pruned.log_weights), [2 / 3, 1 / 3])
    assert pruned.discarded == pytest.approx(0.25)


@pytest.mark.parametrize(("unexplained", "power"), [(0.0, 1.0), (0.5, 2.0), (0.9, 10.0), (np.nan, 1.0)])
def test_data_that_nothing_explains_prune_less(unexplained: float, power: float) -> None:
    """What is kept is what tempered weights w^(1 - u) keep at the ratio as it is configured."""
    limits = PruningConfiguration(4.0, 10)
    assert widened(limits, unexplained).ratio == pytest.approx(4.0**power)
    weights = np.linspace(0.0, -20.0, 30)
    kept = prune(weights, np.arange(30, dtype=np.uint64), np.zeros(0), widened(limits, unexplained)).kept
    tempered = prune(weights / power, np.arange(30, dtype=np.uint64), np.zeros(0), limits).kept
    assert kept.tolist() == tempered.tolist()


def test_what_is_explained_is_pruned_as_configured_whatever_the_ratio() -> None:
    assert widened(PruningConfiguration(1e300, 10), 0.0).ratio == pytest.approx(1e300)


def test_data_that_say_nothing_at_all_prune_by_number_alone() -> None:
    weights = -30.0 * np.arange(20.0)
    limits = widened(PruningConfiguration(4.0, 10), 1.0)
    assert len(prune(weights, np.arange(20, dtype=np.uint64), np.zeros(0), limits).kept) == 10


def test_nothing_to_keep_is_an_error() -> None:
    with pytest.raises(SemanticSlamError, match="no candidate explains"):
        prune(np.array([-np.inf]), np.zeros(1, dtype=np.uint64), np.zeros(0), PruningConfiguration())


def test_a_search_goes_on_as_if_nobody_had_looked() -> None:
    """In part, from where it was, whatever was beside it."""
    stack = planar_stack(np.diag([100.0, 100.0, 0.04, 0.05, 0.05, 0.0005]), PlanarVisibility(), semantics=False)
    many = stack.select(np.zeros(6, dtype=int))
    start = np.random.default_rng(3).normal(size=(6, stack.size))
    search = LevenbergMarquardt(many, start)
    search.advance(5, np.full(6, 1e-3))
    rows = np.array([4, 1])
    part = mode_at(search.select(rows).finished(tolerance=1e-6))
    alone = find_modes(many.select(rows), start[rows])
    np.testing.assert_allclose(part.log_evidence, alone.log_evidence, atol=1e-5)
    for row, found in zip(rows, part.log_evidence, strict=True):
        single = LevenbergMarquardt(many.select(np.array([row])), start[[row]])
        single.advance(5, np.full(1, 1e-3))
        assert mode_at(single.finished(tolerance=1e-6)).log_evidence[0] == found


def test_a_proposal_that_fits_is_not_narrowed_to_its_samples() -> None:
    """The moments of 200 samples in 24 dimensions have eigenvalues from 0.4 to 1.8 of the true ones."""
    mixture = proposal(np.zeros((1, 24)), np.eye(24)[None], np.zeros(1))
    found = adapted(mixture, Samples(np.random.default_rng(0).normal(size=(200, 24)), np.zeros(200)))
    covariance = np.linalg.inv(found.roots[0] @ found.roots[0].T)
    assert 0.9 < np.linalg.eigvalsh(covariance / WIDENED).min() <= np.linalg.eigvalsh(covariance / WIDENED).max() < 1.15
    assert np.linalg.norm(found.means[0]) < 0.2


def test_a_proposal_far_from_its_target_is_adapted_to_it() -> None:
    random = np.random.default_rng(0)
    root = np.linalg.cholesky(np.array([[3.0, 1.0, 0.0], [1.0, 0.5, 0.1], [0.0, 0.1, 0.2]]))
    target = np.array([1.0, -0.5, 2.0]) + random.normal(size=(2000, 3)) @ root.T
    mixture = proposal(np.zeros((1, 3)), np.diag([2.0, 1.0, 0.5])[None], np.zeros(1))
    found = adapted(mixture, Samples(target, np.zeros(2000)))
    np.testing.assert_allclose(found.means[0], [1.0, -0.5, 2.0], atol=0.1)
    covariance = np.linalg.inv(found.roots[0] @ found.roots[0].T) / WIDENED
    np.testing.assert_allclose(covariance, root @ root.T, atol=0.15)
    assert np.abs(np.triu(found.roots[0], 1)).max() == 0.0


def test_a_mode_that_no_sample_is_of_stays_as_it_was() -> None:
    """Not a singular matrix: there is nothing to adapt it to."""
    near = np.random.default_rng(0).normal(size=(200, 2))
    mixture = proposal(np.array([[0.0, 0.0], [60.0, 0.0]]), np.tile(np.eye(2), (2, 1, 1)), np.zeros(2))
    found = adapted(mixture, Samples(near, np.zeros(200)))
    np.testing.assert_allclose(found.means[1], [60.0, 0.0])
    assert np.abs(found.roots[1] @ found.roots[1].T - np.eye(2) / WIDENED).max() < 1e-12
    assert np.abs(found.means[0]).max() < 0.3


def test_a_mode_too_sharp_to_be_inverted_stays_as_it_was() -> None:
    """As where the robot stands on an object: its precision is 10^24 times that of the rest."""
    random = np.random.default_rng(1)
    root = np.eye(3)
    root[:, 0] = 1e12 * random.normal(size=3)
    mixture = Gaussians(np.ones((1, 3)), root[None], np.zeros(1)).with_prior()
    found = adapted(mixture, Samples(random.normal(size=(50, 3)), np.append(np.full(49, -1e3), 0.0)))
    np.testing.assert_allclose(found.means[0], mixture.means[0], rtol=1e-12)
    np.testing.assert_allclose(found.roots[0], mixture.roots[0] / np.sqrt(WIDENED), rtol=1e-12, atol=1e-3)


@pytest.mark.parametrize("logs", [[np.nan, 0.0, 0.0], [-np.inf] * 3, [np.inf, 0.0, 0.0]])
def test_weights_that_are_none_have_no_share(logs: list[float]) -> None:
    assert effective_share(np.array(logs)) == 0.0
    np.testing.assert_allclose(effective_share(np.array([logs, [0.0, 0.0, -np.inf]])), [0.0, 2.0 / 3.0])
