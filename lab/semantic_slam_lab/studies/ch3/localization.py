"""Classification from an uncertain track: certain scores (Figs. 3.4, 3.5), and dropout with odometry and fixes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from semantic_slam.classification.baselines import SCORE_CLIP, ModelBasedClassifier, SimpleBayesClassifier
from semantic_slam.classification.classifier import Scores, SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.localisation import (
    EvidencePerClass,
    EvidenceTracks,
    GeometricTracks,
    SampledTracks,
    replayed,
)
from semantic_slam.classification.processes import ClassProcesses, TestNoise
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.classification.track_posterior import GaussianTrack
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.ch3.beliefs import Belief, biased, odometry_with_fixes
from semantic_slam_lab.studies.ch3.metrics import correct_rates, fans, stacked, summary, true_class_first
from semantic_slam_lab.studies.ch3.model_uncertainty import follow
from semantic_slam_lab.studies.ch3.pages import methods_table, number
from semantic_slam_lab.studies.ch3.pictures import aliasing_figure, fan_figure
from semantic_slam_lab.studies.ch3.scenarios import Scenario, given_scenario, random_scenario
from semantic_slam_lab.studies.ch3.simulation import draw_scores, simulate
from semantic_slam_lab.studies.result import Claim, Figure, Table, write_result

NAME = "ch3_localization"
REALISATIONS, QUICK_REALISATIONS = 200, 6
TRACKS = 200
"""Samples of the track in every method that knows of its uncertainty."""
RANDOM_SIGMA_MAX, RANDOM_SAMPLES = 0.15, 10
OURS = "joint, evidence of each class over tracks of its own"
SETTINGS = {
    "shared": "the given scenario, one offset for the whole track",
    "independent": "the given scenario, an offset of its own at every view",
    "random": "random classes and tracks, odometry with two position fixes, dropout",
}


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Simulate, classify by every method, summarise; returns the files written."""
    count = QUICK_REALISATIONS if quick else REALISATIONS
    outcomes = {}
    for noise in get_args(TestNoise):
        for setting in SETTINGS:
            arguments = [(setting, noise, seed, index) for index in range(count)]
            outcomes[noise, setting] = stacked(repeat(realisation, arguments, jobs, f"{setting}, {noise}"))
    result = summarise(outcomes, count, quick, seed)
    out.mkdir(parents=True, exist_ok=True)
    return write_result(out, result, claims(result), tables(result), figures(out, result))


def realisation(setting: str, test_noise: TestNoise, seed: int, index: int) -> dict[str, Array]:
    """Log posteriors (K, C) of every method in one realisation, the true class first."""
    generator = keyed_generator(NAME, setting, seed, index)
    if setting == "random":
        scenario = random_scenario(generator)
        processes = ClassProcesses(scenario.models, test_noise=test_noise)
        simulated = simulate(
            processes,
            scenario.true_class,
            scenario.track_m,
            generator,
            sigma_max=RANDOM_SIGMA_MAX,
            num_samples=RANDOM_SAMPLES,
        )
        clouds, plain = simulated.with_dropout(), simulated.without()
        belief = odometry_with_fixes(scenario.track_m, generator)
    else:
        scenario, numbers = given_scenario("localization")
        processes = ClassProcesses(scenario.models, test_noise=test_noise)
        drawn = draw_scores(processes, scenario.true_class, scenario.track_m, generator)
        clouds = plain = [Scores.of(row[None]) for row in drawn]
        belief = biased(scenario.track_m + np.array(numbers["bias"]), numbers["sigma"], shared=setting == "shared")
    found = classify(processes, belief, clouds, plain, generator)
    return {name: true_class_first(logs, scenario.true_class) for name, logs in found.items()}


def classify(
    processes: ClassProcesses,
    belief: Belief,
    clouds: Sequence[Scores],
    plain: Sequence[Scores],
    generator: np.random.Generator,
) -> dict[str, Array]:
    """(K, C) log posteriors of every method; ``plain`` are the scores for those that know of no model uncertainty."""
    log_prior = np.zeros(processes.num_classes)
    posteriors = [belief.posterior(k) for k in range(len(clouds))]
    spread = any(scores.covariance.any() for scores in clouds)
    # without spread nothing couples the components, and without samples the recursion is the joint process
    joint = JointClassifier(processes, log_prior, coupling="full" if spread else "per_component")
    of_classes = [
        EvidenceTracks(joint.of_class(c), TRACKS, generator, move=belief.rigid) for c in range(processes.num_classes)
    ]
    found = {
        "ours": _sampled(EvidencePerClass(of_classes, log_prior), clouds, posteriors),
        "joint": _sampled(GeometricTracks(joint, TRACKS, generator), clouds, posteriors),
    }
    recursive = GeometricTracks(RecursiveClassifier(processes, log_prior), TRACKS, generator)
    found["recursive"] = _sampled(recursive, clouds, posteriors) if spread else found["joint"]
    means = [belief.mean(k) for k in range(len(clouds))]
    found["model_based"] = _estimated(ModelBasedClassifier(processes, log_prior), means, plain)
    found["simple_bayes"] = follow(SimpleBayesClassifier(log_prior), means[-1], list(plain))
    return found


def _sampled(
    method: SampledTracks | EvidencePerClass, scores: Sequence[Scores], posteriors: Sequence[GaussianTrack]
) -> Array:
    return np.array([method.update(each, posterior) for each, posterior in zip(scores, posteriors, strict=True)])


def _estimated(classifier: SequentialClassifier, means: Sequence[Array], scores: Sequence[Scores]) -> Array:
    """Along the estimated track as it is at each view; all views again where the estimate of earlier ones changed."""
    found = []
    for k, mean in enumerate(means):
        if k and np.array_equal(mean[:k], means[k - 1]):
            found.append(classifier.update(View(mean[None, k], scores[k])))
        else:
            classifier = replayed(classifier, scores[: k + 1], mean[None])
            found.append(classifier.log_posteriors[0])
    return np.array(found)


def summarise(outcomes: dict[tuple[str, str], dict[str, Array]], count: int, quick: bool, seed: int) -> dict[str, Any]:
    """Everything that the page shows, and that result.json holds."""
    from semantic_slam.pipeline.provenance import revision

    parts: dict[str, dict[str, Any]] = {noise: {} for noise in get_args(TestNoise)}
    for (noise, setting), methods in outcomes.items():
        metrics: dict[str, dict[str, Any]] = {name: summary(logs) for name, logs in methods.items()}
        metrics["ours"] = {"method": OURS, **metrics["ours"]}
        steps = {
            name: {"percentiles": fans(logs), "correct_rate": correct_rates(logs)} for name, logs in methods.items()
        }
        parts[noise][setting] = {"methods": metrics, "steps": steps}
    return {
        "study": NAME,
        "seed": seed,
        "config": {
            "realisations": count,
            **given_scenario("localization")[1],
            "tracks": TRACKS,
            "simple_bayes_clip": SCORE_CLIP,
            "methods_are_of": "test_noise sigma_n, shared offset",
        },
        "revision": revision(),
        "quick": quick,
        "methods": parts["sigma_n"]["shared"]["methods"],
        "test_noise": parts,
    }


def claims(result: dict[str, Any]) -> list[Claim]:
    """What the thesis says of Fig. 3.5, for either reading of its offsets; and what it left open."""
    found = []
    for setting in ("shared", "independent"):
        part = result["test_noise"]["sigma_n"][setting]
        metrics, medians = part["methods"], _medians(part["steps"])
        title = SETTINGS[setting].removeprefix("the given scenario, ")
        peak = int(np.argmax(medians["model_based"]["log_mgr"]))
        found.append(
            Claim(
                f"Model Based infers a wrong class with high confidence ({title})",
                "Sec. 3.4.3.2, Fig. 3.5",
                "peak around step 15",
                f"median log MGR {number(max(medians['model_based']['log_mgr']))} at step {peak}",
                bool(max(medians["model_based"]["log_mgr"]) > np.log(10.0)),
            )
        )
        for name, words in (("recursive", "Eq. 3.20"), ("ours", "our default")):
            found.append(
                Claim(
                    f"Aware of the uncertainty, evidence accumulates without confident mistakes ({words}, {title})",
                    "Sec. 3.4.3.2, Fig. 3.5",
                    "recovers",
                    f"overall log MGR 95 %: {number(metrics[name]['log_mgr_overall_p95'])}, Model Based"
                    f" {number(metrics['model_based']['log_mgr_overall_p95'])}; final median P(true class)"
                    f" {number(medians[name]['p_true'][-1])}",
                    metrics[name]["log_mgr_overall_p95"] < 0.1 * metrics["model_based"]["log_mgr_overall_p95"]
                    and medians[name]["p_true"][-1] > 0.5,
                )
            )
        found.append(_evidence_claim(title, metrics))
    simple = result["methods"]["simple_bayes"]
    found.append(
        Claim(
            "Simple Bayes does well: the scores themselves are not ambiguous",
            "Sec. 3.4.3.2, Fig. 3.5",
            "",
            f"correct rate {number(simple['correct_rate_overall'])} of all steps",
            simple["correct_rate_overall"] > 0.9,
        )
    )
    return [*found, _evidence_claim(SETTINGS["random"], result["test_noise"]["sigma_n"]["random"]["methods"])]


def _evidence_claim(title: str, metrics: dict[str, Any]) -> Claim:
    ours, thesis = metrics["ours"], metrics["joint"]
    return Claim(
        f"Averaging each class's evidence over the tracks is better than Eq. 3.20's posteriors ({title})",
        "ours",
        "",
        f"NLL {number(ours['nll'])} against {number(thesis['nll'])}, correct at all steps"
        f" {number(ours['correct_rate_overall'])} against {number(thesis['correct_rate_overall'])}",
        ours["nll"] < thesis["nll"],
    )


def _medians(steps: dict[str, Any]) -> dict[str, dict[str, list[float]]]:
    return {
        name: {metric: [step[4] for step in rows] for metric, rows in part["percentiles"].items()}
        for name, part in steps.items()
    }


def tables(result: dict[str, Any]) -> list[Table]:
    """Metrics of all methods."""
    return [
        methods_table(f"{words.capitalize()}; test noise: {noise}", result["test_noise"][noise][setting]["methods"])
        for setting, words in SETTINGS.items()
        for noise in result["test_noise"]
    ]


def figures(out: Path, result: dict[str, Any]) -> list[Figure]:
    """Fig. 3.4, and Fig. 3.5 for each setting."""
    scenario, numbers = given_scenario("localization")
    pictures = [
        Figure(
            "Why a bias aliases classes (Fig. 3.4)",
            "Scores of one realisation against the classes' means where the camera is, and where it is believed to be.",
            _aliasing(out / "aliasing.png", scenario, np.array(numbers["bias"]), result["seed"]),
        )
    ]
    rows = (("model_based", "ours"), ("model_based", "recursive"), ("simple_bayes", "ours"))
    for setting, part in result["test_noise"]["sigma_n"].items():
        percentiles = {name: each["percentiles"] for name, each in part["steps"].items()}
        guess = 1.0 / len(scenario.models) if setting != "random" else 0.25
        pictures.append(
            Figure(
                f"Percentiles over the realisations: {SETTINGS[setting]} (Fig. 3.5)",
                "Each shade is ten percent of the realisations, the line the median; dashed: the prior.",
                fan_figure(out / f"fans_{setting}.png", percentiles, rows, guess),
            )
        )
    return pictures


def _aliasing(file: Path, scenario: Scenario, bias_m: Array, seed: int) -> Path:
    processes = ClassProcesses(scenario.models)
    generator = keyed_generator(NAME, "shared", seed, 0)
    scores = draw_scores(processes, scenario.true_class, scenario.track_m, generator)
    means = [processes.posterior(scenario.track_m + offset)[0] for offset in (np.zeros(2), bias_m)]
    return aliasing_figure(file, scores, means, scenario.true_class)
