"""How semantics disambiguate associations over many tracks, by the strength of their dependency on the viewpoint."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.studies.ch3_pages import number
from semantic_slam.studies.ch4_metrics import Row, row_of, summary
from semantic_slam.studies.ch4_pictures import curves_figure, tracks_figure
from semantic_slam.studies.ch4_runs import Method, follow
from semantic_slam.studies.ch4_scenarios import given_scenario, random_scenario, settings
from semantic_slam.studies.ch4_simulation import Run, simulate
from semantic_slam.studies.repetitions import keyed_generator, repeat
from semantic_slam.studies.result import Claim, Figure, Table, write_result

NAME = "ch4_statistics"
DRAWS, RANDOM_LAYOUTS = 4, 50
"""Noise draws of each of the 50 given paths, and random layouts."""
QUICK_TRACKS, QUICK_LAYOUTS = 6, 2
ALPHAS = (0.05, 0.25, 0.5, 0.75, 1.0)
DEFAULT_ALPHA = 0.25
WITH = tuple(Method(alpha) for alpha in ALPHAS)
WITHOUT = Method(None)
OURS, SAMPLED = Method(DEFAULT_ALPHA), Method(DEFAULT_ALPHA, "sampled")
METHODS = (*WITH, WITHOUT, SAMPLED)
WORLDS = {
    "given": "given layout, errors of the map drawn from its prior",
    "exact_map": "given layout, every object exactly where the map has it",
    "random": "random layouts, the prior of the robot drawn",
}
METHODS_OF = {"given": METHODS, "exact_map": (OURS, WITHOUT), "random": (OURS, WITHOUT)}
COLUMNS = {
    "association_entropy": "H(associations) [nats]",
    "component_entropy": "H(components) [nats]",
    "det_position_covariance": "det Sigma [m^4]",
    "error_max_weight_m": "error, max weight [m]",
    "error_weighted_m": "error, weighted [m]",
    "num_hypotheses": "hypotheses",
    "p_true_association_final": "P(true association), final",
    "runs_lost": "runs lost",
    "truth_lost": "truth lost",
    "discarded_mass": "discarded mass",
}
LEAST_P_TRUE = 0.99
REQUIREMENT = "project requirement"
Summaries = Mapping[str, Mapping[str, Any]]


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Simulate, run the engine with every method, summarise; returns the files written."""
    paths = len(given_scenario()[1])
    counts = {
        "given": QUICK_TRACKS if quick else paths * DRAWS,
        "exact_map": QUICK_TRACKS if quick else paths,
        "random": QUICK_LAYOUTS if quick else RANDOM_LAYOUTS,
    }
    worlds: dict[str, dict[str, dict[str, Any]]] = {}
    for world, count in counts.items():
        found = repeat(realisation, [(world, seed, index) for index in range(count)], jobs, world)
        worlds[world] = {method.name: summary([rows[method.name] for rows in found]) for method in METHODS_OF[world]}
    result = summarise(worlds, counts, quick, seed)
    out.mkdir(parents=True, exist_ok=True)
    return write_result(out, result, claims(worlds), tables(worlds), figures(out, worlds, seed))


def realisation(world: str, seed: int, index: int) -> dict[str, Row]:
    """Metrics of every method on one simulated run, which they share."""
    simulated = simulated_run(world, seed, index)
    return {method.name: row_of(follow(simulated, method, seed), len(simulated.frames)) for method in METHODS_OF[world]}


def simulated_run(world: str, seed: int, index: int) -> Run:
    """Run ``index`` of one of ``WORLDS``."""
    generator = keyed_generator(NAME, "random" if world == "random" else "given", seed, index)
    if world == "random":
        scenario, path = random_scenario(generator)
        return simulate(scenario, path, generator)
    scenario, paths = given_scenario()
    return simulate(scenario, paths[index % len(paths)], generator, exact_map=world == "exact_map")


def summarise(worlds: Mapping[str, Summaries], counts: Mapping[str, int], quick: bool, seed: int) -> dict[str, Any]:
    """Everything that result.json holds besides the claims."""
    from semantic_slam.configuration import PruningConfiguration, WeightsConfiguration, to_dict
    from semantic_slam.pipeline.provenance import revision

    given = worlds["given"]
    plain = {name: _numbers(given[method.name]) for name, method in (("ours", OURS), ("sampled", SAMPLED))}
    return {
        "study": NAME,
        "seed": seed,
        "config": {
            "runs": dict(counts),
            "worlds": WORLDS,
            "weights": to_dict(WeightsConfiguration()),
            "pruning": to_dict(PruningConfiguration()),
            "averages": "over runs and keyframes; steps: at each keyframe; final: at the last one",
            **{key: value for key, value in settings().items() if key not in ("note", "paths")},
        },
        "revision": revision(),
        "quick": quick,
        "methods": {
            "ours": {"method": f"alpha {DEFAULT_ALPHA}, {OURS.weights}", **plain["ours"]},
            "no_semantics": _numbers(given[WITHOUT.name]),
            "sampled": plain["sampled"],
        },
        "alphas": {method.name: given[method.name] for method in WITH},
        "no_semantics": given[WITHOUT.name],
        "worlds": {name: dict(methods) for name, methods in worlds.items()},
    }


def _numbers(methods: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in methods.items() if key not in ("steps", "final")}


def claims(worlds: Mapping[str, Summaries]) -> list[Claim]:
    """What has to hold, what the thesis says of Fig. 4.5, and what the samples of the thesis cost."""
    given = worlds["given"]
    ours, without, sampled = given[OURS.name], given[WITHOUT.name], given[SAMPLED.name]
    found = [*_requirements(worlds)]
    for metric in ("association_entropy", "det_position_covariance", "error_max_weight_m", "error_weighted_m"):
        found.append(_lower_for_every_alpha(metric, given))
    found.append(_monotone("det_position_covariance", given, ALPHAS))
    found.append(_monotone("association_entropy", given, [alpha for alpha in ALPHAS if alpha <= 0.5]))
    found.append(
        Claim(
            "Fewer components are kept with semantics",
            "Sec. 4.4",
            "",
            f"{_over_alphas('num_hypotheses', given)}; without {number(without['num_hypotheses'])}",
            all(given[method.name]["num_hypotheses"] < without["num_hypotheses"] for method in WITH),
        )
    )
    found.append(
        Claim(
            f"The thesis's 1000 samples lose the truth no less often than our weights (alpha {DEFAULT_ALPHA})",
            "ours",
            "",
            f"{sampled['truth_lost']} against {ours['truth_lost']} runs end without the true association, P(true)"
            f" {number(sampled['p_true_association_final'])} against {number(ours['p_true_association_final'])}",
            sampled["truth_lost"] >= ours["truth_lost"],
        )
    )
    return found


def _requirements(worlds: Mapping[str, Summaries]) -> list[Claim]:
    lost = {
        world: sum(m["runs_lost"] for name, m in found.items() if name != SAMPLED.name)
        for world, found in worlds.items()
    }
    found = [
        Claim(
            "No run loses all its hypotheses, with semantics of any alpha or without",
            REQUIREMENT,
            "0",
            ", ".join(f"{world}: {count}" for world, count in lost.items()),
            not any(lost.values()),
        )
    ]
    for world, methods in worlds.items():
        p_true = methods[OURS.name]["p_true_association_final"]
        found.append(
            Claim(
                f"At the end the true association is certain with alpha {DEFAULT_ALPHA} ({WORLDS[world]})",
                REQUIREMENT,
                f"at least {LEAST_P_TRUE}",
                f"P(true association) {p_true:.4f}, without semantics"
                f" {number(methods[WITHOUT.name]['p_true_association_final'])}",
                p_true >= LEAST_P_TRUE,
            )
        )
    return found


def _lower_for_every_alpha(metric: str, given: Summaries) -> Claim:
    without = given[WITHOUT.name][metric]
    return Claim(
        f"Semantics lower the {COLUMNS[metric].split(' [')[0]} for every alpha",
        "Fig. 4.5",
        "lower",
        f"{_over_alphas(metric, given)}; without {number(without)}",
        all(given[method.name][metric] < without for method in WITH),
    )


def _monotone(metric: str, given: Summaries, alphas: Sequence[float]) -> Claim:
    values = [given[Method(alpha).name][metric] for alpha in alphas]
    return Claim(
        f"Stronger dependence helps more: {COLUMNS[metric].split(' [')[0]}, alpha up to {alphas[-1]:g}",
        "Sec. 4.4",
        "assists more significantly",
        _over_alphas(metric, given),
        bool(np.all(np.diff(values) < 0.0)),
    )


def _over_alphas(metric: str, given: Summaries) -> str:
    return ", ".join(f"alpha {method.name}: {number(given[method.name][metric])}" for method in WITH)


def tables(worlds: Mapping[str, Summaries]) -> list[Table]:
    """A table per world, a row per method: averages over runs and keyframes."""
    return [
        Table(
            f"{WORLDS[world].capitalize()}: averages over runs and keyframes",
            ("method", *COLUMNS.values()),
            tuple((words(name), *(number(row[key]) for key in COLUMNS)) for name, row in methods.items()),
        )
        for world, methods in worlds.items()
    ]


def words(name: str) -> str:
    """A method's name as a page shows it."""
    if name == WITHOUT.name:
        return "without semantics (DA-BSP)"
    return f"alpha {name}" if name != SAMPLED.name else f"alpha {DEFAULT_ALPHA}, the thesis's 1000 samples"


def figures(out: Path, worlds: Mapping[str, Summaries], seed: int) -> list[Figure]:
    """Fig. 4.3b and Fig. 4.5 in each world."""
    scenario, paths = given_scenario()
    runs = [simulated_run("given", seed, index) for index in range(len(paths))]
    pictures = [
        Figure(
            "The tracks (Fig. 4.3b)",
            "Objects with their headings, and the true tracks of one noise draw of every path; the cross is where the"
            " robot believes to start.",
            tracks_figure(out / "tracks.png", scenario, runs),
        )
    ]
    for world, methods in worlds.items():
        steps = {words(name): row["steps"] for name, row in methods.items()}
        pictures.append(
            Figure(
                f"Means over the runs: {WORLDS[world]} (Fig. 4.5)",
                f"Bands: the middle half of the runs, for alpha {DEFAULT_ALPHA} and without semantics.",
                curves_figure(out / f"curves_{world}.png", steps, (words(OURS.name), words(WITHOUT.name))),
            )
        )
    return pictures
