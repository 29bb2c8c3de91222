"""Classification from scores with model uncertainty, the track known (Figs. 3.2, 3.3; Alg. 3.2)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np

from semantic_slam.classification.baselines import SCORE_CLIP, ModelBasedClassifier, SimpleBayesClassifier
from semantic_slam.classification.classifier import Scores, SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.processes import ClassProcesses, TestNoise
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.ch3.metrics import correct_rates, fans, stacked, summary, true_class_first
from semantic_slam_lab.studies.ch3.pages import LINES, methods_table, number
from semantic_slam_lab.studies.ch3.pictures import fan_figure, scores_figure
from semantic_slam_lab.studies.ch3.scenarios import Scenario, given_scenario, random_scenario
from semantic_slam_lab.studies.ch3.simulation import SimulatedScores, simulate
from semantic_slam_lab.studies.result import Claim, Figure, Table, write_result

NAME = "ch3_model_uncertainty"
REALISATIONS, QUICK_REALISATIONS = 300, 30
STEP = 15
"""Step at which the thesis reads Fig. 3.3."""

Make = Callable[[ClassProcesses, Array], SequentialClassifier]
AWARE: dict[str, Make] = {
    "ours": JointClassifier,
    "recursive": RecursiveClassifier,
    "joint_per_component": lambda p, prior: JointClassifier(p, prior, coupling="per_component"),
    "recursive_per_component": lambda p, prior: RecursiveClassifier(p, prior, coupling="per_component"),
}
"""Methods that are given the dropout samples."""
UNAWARE: dict[str, Make] = {
    "model_based": ModelBasedClassifier,
    "simple_bayes": lambda _, prior: SimpleBayesClassifier(prior),
}
"""Methods that are given the noised score alone."""


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Simulate, classify by every method, summarise; returns the files written."""
    count = QUICK_REALISATIONS if quick else REALISATIONS
    outcomes = {
        source: {
            noise: stacked(
                repeat(realisation, [(source, noise, seed, i) for i in range(count)], jobs, f"{source}, {noise}")
            )
            for noise in get_args(TestNoise)
        }
        for source in ("given", "random")
    }
    result = summarise(outcomes, count, quick, seed)
    out.mkdir(parents=True, exist_ok=True)
    return write_result(out, result, claims(result), tables(result), figures(out, result, seed))


def realisation(source: str, test_noise: TestNoise, seed: int, index: int) -> dict[str, Array]:
    """Log posteriors (K, C) of every method in one realisation, the true class first."""
    scenario, processes, scores = simulated(source, test_noise, seed, index)
    log_prior = np.zeros(processes.num_classes)
    clouds, noised = scores.with_dropout(), scores.without()
    runs = {name: (make, clouds) for name, make in AWARE.items()} | {n: (make, noised) for n, make in UNAWARE.items()}
    return {
        name: true_class_first(follow(make(processes, log_prior), scenario.track_m, given), scenario.true_class)
        for name, (make, given) in runs.items()
    }


def simulated(
    source: str, test_noise: TestNoise, seed: int, index: int
) -> tuple[Scenario, ClassProcesses, SimulatedScores]:
    """What happens in a realisation; its key makes it the same wherever it runs."""
    generator = keyed_generator(NAME, source, seed, index)
    given, settings = given_scenario("model_uncertainty")
    scenario = given if source == "given" else random_scenario(generator)
    processes = ClassProcesses(scenario.models, test_noise=test_noise)
    scores = simulate(
        processes,
        scenario.true_class,
        scenario.track_m,
        generator,
        sigma_max=settings["sigma_max"],
        num_samples=settings["samples_per_step"],
    )
    return scenario, processes, scores


def follow(classifier: SequentialClassifier, track_m: Array, scores: list[Scores]) -> Array:
    """(K, C) log posteriors along a known track."""
    return np.array([classifier.update(View(at[None], each)) for at, each in zip(track_m, scores, strict=True)])


def summarise(outcomes: dict[str, dict[str, dict[str, Array]]], count: int, quick: bool, seed: int) -> dict[str, Any]:
    """Everything that the page shows, and that result.json holds."""
    from semantic_slam.pipeline.provenance import revision

    metrics: dict[str, dict[str, dict[str, Any]]] = {
        source: {
            noise: {"methods": {name: summary(logs) for name, logs in of.items()}} for noise, of in by_noise.items()
        }
        for source, by_noise in outcomes.items()
    }
    for by_noise in metrics.values():
        for part in by_noise.values():
            part["methods"]["ours"] = {"method": "joint", **part["methods"]["ours"]}
            part["methods"]["joint"] = part["methods"]["ours"]
    steps = {
        noise: {name: {"percentiles": fans(logs), "correct_rate": correct_rates(logs)} for name, logs in of.items()}
        for noise, of in outcomes["given"].items()
    }
    return {
        "study": NAME,
        "seed": seed,
        "config": {
            "realisations": count,
            **given_scenario("model_uncertainty")[1],
            "simple_bayes_clip": SCORE_CLIP,
            "methods_are_of": "test_noise sigma_n, the given scenario",
        },
        "revision": revision(),
        "quick": quick,
        "methods": metrics["given"]["sigma_n"]["methods"],
        "test_noise": metrics["given"],
        "random": metrics["random"],
        "steps": steps,
    }


def claims(result: dict[str, Any]) -> list[Claim]:
    """What the thesis says of Fig. 3.3, for its recursion and for our default, in both settings of the test noise."""
    found = []
    for noise, title in (("none", "no test noise (Eq. 3.13 as printed)"), ("sigma_n", "test noise sigma_n")):
        metrics, steps = result["test_noise"][noise]["methods"], result["steps"][noise]
        for name in ("recursive", "ours"):
            found += _claims_of(name, f"{LINES[name]}, {title}", metrics, steps)
    metrics, steps = result["methods"], result["steps"]["sigma_n"]
    ours, simple = (steps[name]["correct_rate"][STEP] for name in ("ours", "simple_bayes"))
    found.append(
        Claim(
            "Simple Bayes performs poorly where a view looks like another class",
            "Fig. 3.3, around step 15",
            "",
            f"correct rate at step {STEP}: {number(simple)}, ours {number(ours)}",
            simple < ours,
        )
    )
    best, other = metrics["ours"]["nll"], metrics["recursive"]["nll"]
    found.append(
        Claim(
            "The coherent process serves better than the recursion, so it is the default",
            "ours",
            "",
            f"NLL {number(best)} against {number(other)}; final correct rate"
            f" {number(metrics['ours']['correct_rate_final'])} against"
            f" {number(metrics['recursive']['correct_rate_final'])}",
            best < other,
        )
    )
    return found


def _claims_of(name: str, title: str, metrics: dict[str, Any], steps: dict[str, Any]) -> list[Claim]:
    own, base = (steps[method]["percentiles"] for method in (name, "model_based"))
    low, base_low = own["p_true"][STEP][1], base["p_true"][STEP][1]
    high, base_high = own["log_mgr"][STEP][7], base["log_mgr"][STEP][7]
    rates = [metrics[method]["correct_rate_overall"] for method in (name, "model_based")]
    return [
        Claim(
            f"More stable than Model Based: 20th percentile of P(true class) at step {STEP} ({title})",
            "Sec. 3.4.3.1",
            "above 0.33; Model Based below 0.2",
            f"{number(low)}; Model Based {number(base_low)}",
            low > base_low,
        ),
        Claim(
            f"Fewer confident mistakes: 80th percentile of log MGR at step {STEP} ({title})",
            "Sec. 3.4.3.1",
            "Model Based above 1, ours less",
            f"{number(high)}; Model Based {number(base_high)}",
            high < base_high,
        ),
        Claim(
            f"Fewer confident mistakes: 95th percentile of log MGR over all steps ({title})",
            "Fig. 3.3",
            "",
            f"{number(metrics[name]['log_mgr_overall_p95'])}; Model Based"
            f" {number(metrics['model_based']['log_mgr_overall_p95'])}",
            metrics[name]["log_mgr_overall_p95"] < metrics["model_based"]["log_mgr_overall_p95"],
        ),
        Claim(
            f"The correct class is the most likely one more often ({title})",
            "Fig. 3.3",
            "",
            f"{number(rates[0])} of all steps; Model Based {number(rates[1])}",
            rates[0] > rates[1],
        ),
    ]


def tables(result: dict[str, Any]) -> list[Table]:
    """Metrics of all methods."""
    titles = {
        "test_noise": f"Given scenario, {result['config']['realisations']} realisations",
        "random": "Random classes and tracks, another in each realisation",
    }
    return [
        methods_table(f"{title}, test noise: {noise}", part["methods"])
        for key, title in titles.items()
        for noise, part in result[key].items()
    ]


def figures(out: Path, result: dict[str, Any], seed: int) -> list[Figure]:
    """Fig. 3.2, and Fig. 3.3 for both settings of the test noise."""
    scenario, processes, scores = simulated("given", "sigma_n", seed, 0)
    mean, covariance = processes.posterior(scenario.track_m)
    pictures = [
        Figure(
            "One realisation (Fig. 3.2)",
            "Mean of the true class's process, two standard deviations about it, and the noised scores on the way.",
            scores_figure(out / "scores.png", mean, covariance, scenario.true_class, scores.noised),
        )
    ]
    rows = (("model_based", "ours"), ("model_based", "recursive"), ("simple_bayes", "ours"))
    for noise, steps in result["steps"].items():
        percentiles = {name: part["percentiles"] for name, part in steps.items()}
        pictures.append(
            Figure(
                f"Percentiles over the realisations, test noise: {noise} (Fig. 3.3)",
                "Each shade is ten percent of the realisations, the line the median; dashed: the prior.",
                fan_figure(out / f"fans_{noise}.png", percentiles, rows, 1.0 / processes.num_classes),
            )
        )
    return pictures
