"""Fixtures of chapter 3 (schema exact-ch3/1): every answer is known exactly, and asked of the classifiers in use."""

import warnings
from typing import Any

import numpy as np

from semantic_slam.classification.baselines import ModelBasedClassifier, SimpleBayesClassifier
from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores, SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.metrics import correct, log_mgr, msde
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.classification.recursive import RecursiveClassifier

BEYOND = 690.0
"""Magnitude from which exp leaves the doubles: what a fixture calls null (not finite) has to be at least this large."""


def check_classification(data: dict) -> None:
    given, expected = data["input"], data["expected"]
    found = answers(given)
    found["metrics"] |= {"model_based_log_mgr": log_mgr(found["model_based_log_posterior"], given["gt"])}
    _compare(found, {name: value for name, value in expected.items() if name in found}, data["tol"])
    if unknown := set(expected) - set(found):
        warnings.warn(f"{data['name']}: nothing was compared with {sorted(unknown)}", stacklevel=2)


def answers(given: dict) -> dict[str, Any]:
    """What our classifiers say of a fixture's input, under the names of its answers."""
    processes = ClassProcesses([ClassModel.from_json(row) for row in given["classes"]], test_noise=given["test_noise"])
    log_prior = np.log(given["prior"])
    views = _views(given)
    of_samples = "samples" in given["model_based_measurement"]  # else mu_z
    plain = [View(view.locations_m, Scores.of(view.scores.samples)) for view in views] if of_samples else views
    mean, covariance = processes.posterior(np.array(given["X"]))
    found = {
        "gp_mean": mean,
        "gp_cov": covariance,
        "joint_log_posterior": _posteriors(JointClassifier(processes, log_prior), views),
        "model_based_log_posterior": _posteriors(ModelBasedClassifier(processes, log_prior), plain),
        **_recursion(RecursiveClassifier(processes, log_prior), views),
    }
    posteriors = found["log_posterior"]
    found["posterior"] = np.exp(posteriors)
    found["metrics"] = {
        "p_gt": np.exp(posteriors[:, given["gt"]]),
        "msde": msde(posteriors, given["gt"]),
        "log_mgr": log_mgr(posteriors, given["gt"]),
        "correct": correct(posteriors, given["gt"]),
    }
    if processes.num_components == processes.num_classes:
        simple = SimpleBayesClassifier(log_prior, clip=given["simple_bayes_eps"])
        found["simple_bayes_log_posterior"] = _posteriors(simple, plain)
    if "pose_samples" in given:
        tracks = np.array(given["pose_samples"])
        sampled = RecursiveClassifier(processes, log_prior, len(tracks))
        moved = [View(tracks[:, k], view.scores) for k, view in enumerate(views)]
        found["log_posterior_localisation"] = _posteriors(sampled, moved)
        found["log_posterior_per_pose_sample_final"] = sampled.log_posteriors
    return found


def _views(given: dict) -> list[View]:
    columns = zip(given["X"], given["samples"], given["mu_z"], given["Sigma_z"], strict=True)
    return [View(np.array([x]), Scores(np.array(z), np.array(mu), np.array(s))) for x, z, mu, s in columns]


def _posteriors(classifier: SequentialClassifier, views: list[View]) -> np.ndarray:
    return np.array([classifier.update(view) for view in views])


def _recursion(classifier: RecursiveClassifier, views: list[View]) -> dict[str, Any]:
    found: dict[str, Any] = {"step_mean": [], "step_cov": [], "step_loglik": [], "log_posterior": []}
    for view in views:
        prediction = classifier.predict(view.locations_m)
        found["step_mean"].append(prediction.mean[0])
        found["step_cov"].append(prediction.covariance[0])
        found["step_loglik"].append(prediction.log_likelihoods(view.scores.samples)[0])
        found["log_posterior"].append(classifier.update(view))
    return found | {"log_posterior": np.array(found["log_posterior"])}


def _compare(found: Any, expected: Any, tolerance: dict[str, float], where: str = "") -> None:
    """Numbers against numbers, however deep; null stands for a number that doubles cannot hold."""
    if isinstance(expected, dict):
        for name, value in expected.items():
            _compare(found[name], value, tolerance, f"{where}.{name}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), where
        for index, value in enumerate(expected):
            _compare(found[index], value, tolerance, f"{where}[{index}]")
    elif expected is None:
        assert not abs(found) < BEYOND, f"{where}: {found}, the fixture has no finite number"
    else:
        difference = abs(float(found) - expected)
        limit = tolerance["abs"] + tolerance["rel"] * abs(expected)
        assert difference <= limit, f"{where}: {found}, expected {expected}"
