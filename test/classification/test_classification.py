"""Methods of chapter 3: against whole matrices, and what must hold of them."""

import numpy as np
import pytest
from worlds.exact.chapter3_fixtures import check_classification
from worlds.exact.dense_classification import KINDS, Dense, problem

from semantic_slam.classification.baselines import ModelBasedClassifier, SimpleBayesClassifier
from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores, SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.metrics import correct, log_mgr, msde
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.errors import InputError

CASES = [(kind, noise) for kind in KINDS for noise in ("sigma_n", "none") if (kind, noise) != ("repeated", "none")]
"""Views a millimetre apart without noise: there the whole matrices are singular to doubles."""


@pytest.mark.parametrize("kind, test_noise", CASES)
@pytest.mark.parametrize("seed", range(3))
def test_incremental_equals_whole_matrices(kind: str, test_noise: str, seed: int) -> None:
    """Every answer that a fixture would hold, for clouds of all kinds."""
    given = problem(kind, test_noise, seed)
    data = {"name": kind, "input": given, "expected": Dense(given).answers(), "tol": {"abs": 1e-6, "rel": 1e-6}}
    check_classification(data)


@pytest.mark.parametrize("test_noise", ["sigma_n", "none"])
def test_recursion_telescopes_to_the_joint_likelihood(test_noise: str) -> None:
    """One sample and no spread: p(s_k | s_0:k-1) multiplied up is p(s_0:k), whatever the method's name."""
    given = problem("one_sample", test_noise, seed=4, num_views=12)
    processes, log_prior, views = _parts(given)
    methods = [make(processes, log_prior) for make in (RecursiveClassifier, JointClassifier, ModelBasedClassifier)]
    exact = Dense(given).joint(np.array(given["mu_z"]), noisy=False)
    for k, view in enumerate(views):
        for method in methods:
            np.testing.assert_allclose(method.update(view), exact[k], rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("make", [RecursiveClassifier, JointClassifier])
def test_per_component_neglects_what_is_off_the_diagonal(make: type) -> None:
    given = problem("arbitrary", "sigma_n", seed=1)
    processes, log_prior, views = _parts(given)
    diagonal = given | {"Sigma_z": [np.diag(np.diag(s)).tolist() for s in given["Sigma_z"]]}
    neglecting, exact = make(processes, log_prior, coupling="per_component"), make(processes, log_prior)
    for view, without in zip(views, _parts(diagonal)[2], strict=True):
        np.testing.assert_allclose(neglecting.update(view), exact.update(without), atol=1e-9)


def test_joint_does_not_depend_on_the_order() -> None:
    processes, log_prior, views = _parts(problem("plain", "sigma_n", seed=2))
    forward, backward = JointClassifier(processes, log_prior), JointClassifier(processes, log_prior)
    results = [[method.update(view) for view in order] for method, order in ((forward, views), (backward, views[::-1]))]
    np.testing.assert_allclose(results[0][-1], results[1][-1], atol=1e-9)
    np.testing.assert_allclose(forward.log_evidence, backward.log_evidence, atol=1e-9)


def test_window_conditions_on_the_last_views_alone() -> None:
    given = problem("plain", "sigma_n", seed=5, num_views=14)
    processes, log_prior, views = _parts(given)
    windowed = RecursiveClassifier(processes, log_prior, window=4)
    exact = Dense(given).recursion(window=4)
    for k, view in enumerate(views):
        np.testing.assert_allclose(windowed.update(view), exact["log_posterior"][k], atol=1e-8)
    assert windowed.dropped == len(views) - 4


@pytest.mark.parametrize("coupling", ["full", "per_component"])
def test_joint_window_forgets_a_view_as_if_it_had_not_been(coupling: str) -> None:
    """Predicting view k after views k-3..k-1 came alone gives the same likelihood as after dropping those before."""
    processes, log_prior, views = _parts(problem("plain", "sigma_n", seed=6, num_views=9))
    windowed = JointClassifier(processes, log_prior, coupling=coupling, window=3)
    gained = [np.diff([log_prior, *map(windowed.update, views)], axis=0)]
    for k in range(3, len(views)):
        short = JointClassifier(processes, log_prior, coupling=coupling)
        last = np.diff([short.update(view) for view in views[k - 3 : k + 1]], axis=0)[-1]
        np.testing.assert_allclose(gained[0][k] - gained[0][k][0], last - last[0], atol=1e-8)
    assert windowed.dropped == 6


@pytest.mark.parametrize("make", [RecursiveClassifier, JointClassifier, ModelBasedClassifier])
def test_replaced_tracks_go_on_like_their_own(make: type) -> None:
    given = problem("plain", "sigma_n", seed=7)
    processes, log_prior, views = _parts(given)
    tracks = np.array(given["pose_samples"])
    whole, other = make(processes, log_prior, 4), make(processes, log_prior, 2)
    moved = [tracks[:2, k] + 1.0 for k in range(len(views))]
    for k, view in enumerate(views):
        if k == 3:
            whole.replace(np.array([1, 3]), other, np.array([0, 1]))
        whole.update(View(np.insert(tracks[[0, 2], k], [1, 2], moved[k], axis=0), view.scores))
        if k < 3:
            other.update(View(moved[k], view.scores))
    scratch = make(processes, log_prior, 2)
    for k, view in enumerate(views):
        scratch.update(View(moved[k], view.scores))
    np.testing.assert_allclose(whole.log_posteriors[[1, 3]], scratch.log_posteriors, atol=1e-9)
    np.testing.assert_allclose(whole.log_evidence[[1, 3]], scratch.log_evidence, atol=1e-9)


@pytest.mark.parametrize("make", [RecursiveClassifier, JointClassifier, ModelBasedClassifier])
def test_the_same_view_without_noise_stays_finite(make: type) -> None:
    """Eq. 3.13 as printed makes the covariance of a repeated view singular."""
    given = problem("plain", "none", seed=8)
    processes, log_prior, views = _parts(given)
    method = make(processes, log_prior)
    for view in [views[0]] * 5:
        assert np.isfinite(method.update(view)).all()


@pytest.mark.parametrize("make", [RecursiveClassifier, JointClassifier])
def test_noise_with_the_kernels_correlation_makes_a_repeated_view_worthless(make: type) -> None:
    given = problem("one_sample", "sigma_n", seed=9)
    _, log_prior, views = _parts(given)
    models = [ClassModel.from_json(row) for row in given["classes"]]
    correlated = make(ClassProcesses(models, view_noise="kernel"), log_prior)
    independent = make(ClassProcesses(models), log_prior)
    first = correlated.update(views[0])
    np.testing.assert_allclose(independent.update(views[0]), first, atol=1e-12)
    for _ in range(5):
        np.testing.assert_allclose(correlated.update(views[0]), first, atol=1e-6)
        again = independent.update(views[0])
    assert np.abs(again - first).max() > 0.1


def test_simple_bayes_multiplies_clipped_scores() -> None:
    method = SimpleBayesClassifier(np.log([0.5, 0.5]), clip=0.1)
    method.update(View(np.zeros((1, 2)), Scores.of(np.array([[0.9, 0.1], [0.7, 0.3]]))))
    found = method.update(View(np.zeros((1, 2)), Scores.of(np.array([[1.0, 0.0]]))))
    np.testing.assert_allclose(np.exp(found), [0.8 / 0.82, 0.02 / 0.82])  # 0.8 * 1.0 against 0.2 * 0.1


def test_inputs_on_the_circle_forget_the_range_and_polar_ones_keep_it() -> None:
    views = np.array([[2.0, 1.0], [4.0, 2.0], [2.0, 1.0 + 1e-3]])
    models = [ClassModel.from_json(row) for row in problem("plain", "sigma_n", seed=0)["classes"]]
    processes = ClassProcesses(models, input_map="unit_circle")
    mean, _ = processes.posterior(views)
    np.testing.assert_allclose(mean[:, 0], mean[:, 1])
    assert not np.allclose(mean[:, 0], mean[:, 2], atol=1e-9)
    spheres = [
        ClassModel(
            np.c_[model.inputs, np.zeros(9)], model.scores, model.signal_variance, _wide(model), model.noise_sigma
        )
        for model in models
    ]
    around = 3.0 * np.array([[-1.0, 1e-9], [-1.0, -1e-9], [-2.0, 1e-9]])  # azimuth pi, -pi, and further away
    mean, _ = ClassProcesses(spheres, input_map="polar").posterior(around)
    np.testing.assert_allclose(mean[:, 0], mean[:, 1], atol=1e-8)
    assert not np.allclose(mean[:, 0], mean[:, 2], atol=1e-3)


def _wide(model: ClassModel) -> np.ndarray:
    return np.stack([np.eye(3) * length[0, 0] for length in model.length_squared])


def test_metrics_of_two_steps() -> None:
    logs = np.log([[0.5, 0.3, 0.2], [0.1, 0.8, 0.1]])
    np.testing.assert_allclose(msde(logs, 0), [(0.25 + 0.09 + 0.04) / 3, (0.81 + 0.64 + 0.01) / 3])
    np.testing.assert_allclose(log_mgr(logs, 0), [0.0, np.log(8.0)])
    assert correct(logs, 0).tolist() == [True, False]


def test_models_that_do_not_fit_together_are_refused() -> None:
    row = problem("plain", "sigma_n", seed=0)["classes"][0]
    with pytest.raises(InputError, match="sigma_n"):
        ClassModel.from_json({name: value for name, value in row.items() if name != "sigma_n"})
    with pytest.raises(InputError, match="length_squared"):
        ClassModel.from_json(row | {"L": row["L"][:1]})
    with pytest.raises(InputError, match="positive"):
        ClassModel.from_json(row | {"sigma2": [0.1, 0.0]})


def _parts(given: dict) -> tuple[ClassProcesses, np.ndarray, list[View]]:
    processes = ClassProcesses([ClassModel.from_json(row) for row in given["classes"]], test_noise=given["test_noise"])
    columns = zip(given["X"], given["samples"], given["mu_z"], given["Sigma_z"], strict=True)
    views = [View(np.array([x]), Scores(np.array(z), np.array(mu), np.array(s))) for x, z, mu, s in columns]
    return processes, np.log(given["prior"]), views


def test_every_method_shares_one_interface() -> None:
    processes, log_prior, views = _parts(problem("plain", "sigma_n", seed=0))
    methods: list[SequentialClassifier] = [
        RecursiveClassifier(processes, log_prior, window=3),
        JointClassifier(processes, log_prior),
        ModelBasedClassifier(processes, log_prior),
        SimpleBayesClassifier(log_prior),
    ]
    for method in methods:
        found = [method.update(view) for view in views][-1]
        np.testing.assert_allclose(np.exp(found).sum(), 1.0)
        again = method.empty(1)
        np.testing.assert_allclose([again.update(view) for view in views][-1], found, atol=1e-12)
