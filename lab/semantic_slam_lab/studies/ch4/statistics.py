"""How semantics disambiguate associations over many tracks, by the strength of their dependency on the viewpoint."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.ch4.claims import claims, tables
from semantic_slam_lab.studies.ch4.methods import (
    DEFAULT_ALPHA,
    METHODS_OF,
    OURS,
    SAMPLED,
    WITH,
    WITHOUT,
    WORLDS,
    Summaries,
    words,
)
from semantic_slam_lab.studies.ch4.metrics import Row, row_of, summary
from semantic_slam_lab.studies.ch4.pictures import curves_figure, tracks_figure
from semantic_slam_lab.studies.ch4.runs import follow
from semantic_slam_lab.studies.ch4.scenarios import given_scenario, random_scenario, settings
from semantic_slam_lab.studies.ch4.simulation import Run, simulate
from semantic_slam_lab.studies.result import Figure, write_result

NAME = "ch4_statistics"
RUNS = {"given": 50, "exact_map": 20, "random": 20}
"""The 50 given paths with noise of their own each; the first of them with an exact map; random layouts."""
QUICK_RUNS = {"given": 3, "exact_map": 1, "random": 1}


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Simulate, run the engine with every method, summarise; returns the files written."""
    worlds: dict[str, dict[str, dict[str, Any]]] = {}
    for world, count in (QUICK_RUNS if quick else RUNS).items():
        found = repeat(realisation, [(world, seed, index) for index in range(count)], jobs, world)
        worlds[world] = {method.name: summary([rows[method.name] for rows in found]) for method in METHODS_OF[world]}
    result = summarise(worlds, quick, seed)
    names = {method.name: words(method.name) for methods in METHODS_OF.values() for method in methods}
    out.mkdir(parents=True, exist_ok=True)
    return write_result(out, result, claims(worlds), tables(worlds, names), figures(out, worlds, names, seed))


def realisation(world: str, seed: int, index: int) -> dict[str, Row]:
    """Metrics of every method on one simulated run, which they share."""
    simulated = simulated_run(world, seed, index)
    return {method.name: row_of(follow(simulated, method, seed), len(simulated.frames)) for method in METHODS_OF[world]}


def simulated_run(world: str, seed: int, index: int) -> Run:
    """Run ``index`` of one of ``WORLDS``; the given layout's runs share their noise between its worlds."""
    generator = keyed_generator(NAME, "random" if world == "random" else "given", seed, index)
    if world == "random":
        scenario, path = random_scenario(generator)
        return simulate(scenario, path, generator)
    scenario, paths = given_scenario()
    return simulate(scenario, paths[index % len(paths)], generator, exact_map=world == "exact_map")


def summarise(worlds: Mapping[str, Summaries], quick: bool, seed: int) -> dict[str, Any]:
    """Everything that result.json holds besides the claims."""
    from semantic_slam.configuration import PruningConfiguration, WeightsConfiguration, to_dict
    from semantic_slam.pipeline.provenance import revision

    given = worlds["given"]
    return {
        "study": NAME,
        "seed": seed,
        "config": {
            "worlds": WORLDS,
            "weights": to_dict(WeightsConfiguration()),
            "pruning": to_dict(PruningConfiguration()),
            "averages": "over runs and keyframes; steps: at each keyframe; final: at the last one",
            **{key: value for key, value in settings().items() if key not in ("note", "paths")},
        },
        "revision": revision(),
        "quick": quick,
        "methods": {
            "ours": {"method": f"alpha {DEFAULT_ALPHA}, default weights and pruning", **_numbers(given[OURS.name])},
            "no_semantics": _numbers(given[WITHOUT.name]),
            "sampled": _numbers(given[SAMPLED.name]),
        },
        "alphas": {method.name: given[method.name] for method in WITH},
        "no_semantics": given[WITHOUT.name],
        "worlds": {name: dict(methods) for name, methods in worlds.items()},
    }


def _numbers(method: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in method.items() if key not in ("steps", "final")}


def figures(out: Path, worlds: Mapping[str, Summaries], names: Mapping[str, str], seed: int) -> list[Figure]:
    """Fig. 4.3b, and Fig. 4.5 in each world."""
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
        steps = {names[name]: row["steps"] for name, row in methods.items()}
        banded = (names[OURS.name], names[WITHOUT.name])
        pictures.append(
            Figure(
                f"Means over the runs: {WORLDS[world]} (Fig. 4.5)",
                f"Bands: the middle half of the runs, for alpha {DEFAULT_ALPHA} and without semantics.",
                curves_figure(out / f"curves_{world}.png", steps, banded),
            )
        )
    return pictures
