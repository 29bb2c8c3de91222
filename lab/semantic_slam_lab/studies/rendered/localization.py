"""A desk seen along three tracks that are known with errors, by the real network (Sec. 3.4.4.2)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.classification.classifier import Scores
from semantic_slam.classification.processes import TestNoise
from semantic_slam.configuration import Configuration, to_dict
from semantic_slam.geometry.arrays import Array
from semantic_slam.pipeline.provenance import revision
from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.ch3.pages import number
from semantic_slam_lab.studies.rendered import figures as draw
from semantic_slam_lab.studies.rendered.aliasing import AliasingMap, aliasing_map, fixed_tracks
from semantic_slam_lab.studies.rendered.methods import TEST_NOISES, class_processes
from semantic_slam_lab.studies.rendered.models import HALF_WIDTH_M, TrainedModels, train_models
from semantic_slam_lab.studies.rendered.pages import NAMES, Methods, lowest_nll, methods_table, summaries
from semantic_slam_lab.studies.rendered.realisations import ALL, SWEPT, WORDS, Problem, realisation
from semantic_slam_lab.studies.rendered.views import CLASSES, Subject, measure
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Figure, Table, write_result

NAME = "rendered_localization"
TRUE_CLASS = CLASSES.index("desk")
GRID_STEP_M, QUICK_GRID_STEP_M = 0.35, 0.45
SIGMA_M = 0.1
SWEEP_M, QUICK_SWEEP_M = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2), (0.01, 0.2)
REALISATIONS, SWEEP_REALISATIONS, QUICK_REALISATIONS = 100, 25, 8
THESIS = {
    "easy": "Model Based 1.0, 0.97; 0, 0; theirs 1.0, 0.974; 0, 0",
    "moderate": "Model Based 0.958, 0.90; 0, 8.8; theirs 1.0, 0.946; 0, 0.007",
    "hard": "Model Based 0.66, 0.64; 48.6, 29.0; theirs 0.72, 0.70; 1.1, 1.26",
}
"""Table 3.2: correct rate final, overall; 95th percentile of log MGR, final, overall."""
TRACK_COLOURS = {"easy": "magenta", "moderate": "black", "hard": "red"}

Outcome = dict[str, dict[str, dict[str, Array]]]  # test noise -> track -> method -> (N, K, C) log posteriors
Sweep = dict[str, dict[str, dict[str, Any]]]  # track -> sigma in cm -> methods


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, fit, fix the tracks, classify and compare; returns the files written."""
    out.mkdir(parents=True, exist_ok=True)
    trained = train_models(seed, jobs, QUICK_GRID_STEP_M if quick else GRID_STEP_M)
    aliasing = aliasing_map(class_processes(trained.models, "sigma_n"), TRUE_CLASS)
    tracks = fixed_tracks(aliasing, TRUE_CLASS, keyed_generator(NAME, "tracks", seed))
    problems = [_problem(name, track, seed, jobs) for name, track in tracks.items()]
    count = QUICK_REALISATIONS if quick else REALISATIONS
    outcome: Outcome = {
        noise: {
            problem.name: _repeated(trained, noise, problem, SIGMA_M, ALL, count, seed, jobs) for problem in problems
        }
        for noise in TEST_NOISES
    }
    sweep = _sweep(trained, problems, quick, seed, jobs)
    result = _result(outcome, sweep, tracks, count, seed, quick)
    return write_result(out, result, claims(result), _tables(result), figures(out, aliasing, tracks, outcome))


def claims(result: Mapping[str, Any]) -> list[Claim]:
    """The thesis's statements and the project's requirements beside what was measured."""
    found = []
    for noise in TEST_NOISES:
        tracks = {name: part["methods"] for name, part in result["test_noise"][noise]["tracks"].items()}
        found += [
            _rate_claim("Hard track: correct rate at least Model Based's + 0.06", tracks["hard"], 0.06, noise),
            _ratio_claim(tracks["hard"], noise),
            _rate_claim("Moderate track: correct rate no worse", tracks["moderate"], 0.0, noise),
            _rate_claim("Easy track: correct rate without loss", tracks["easy"], 0.0, noise),
            *(lowest_nll(methods, f"{name} track, {NAMES[noise]}") for name, methods in tracks.items()),
            *(_table_3_2(name, methods, noise) for name, methods in tracks.items()),
        ]
    return found


def figures(out: Path, aliasing: AliasingMap, tracks: Mapping[str, Array], outcome: Outcome) -> list[Figure]:
    """Figs. 3.9, 3.11 and the reliability diagram."""
    maps = {"location right": aliasing.unbiased, "location wrong by +10 cm in x": aliasing.biased}
    coloured = {TRACK_COLOURS[name]: track for name, track in tracks.items()}
    found = [
        Figure(
            "Aliasing map (Fig. 3.9a)",
            "Classes that Model Based finds from one view of a desk; magenta easy, black moderate, red hard track.",
            draw.class_maps(out / "aliasing.png", maps, HALF_WIDTH_M, coloured),
        )
    ]
    for noise, by_track in outcome.items():
        rows = {name: {each: by_track[name][each] for each in SWEPT} for name in ("hard", "moderate", "easy")}
        file = draw.fans(out / f"fans_{noise}.png", rows, TRUE_CLASS)
        found.append(Figure(f"Over the realisations (Fig. 3.11), {NAMES[noise]}", "Percentiles 10 to 90.", file))
    pooled = {
        NAMES[noise]: {name: np.concatenate([of[name] for of in by_track.values()]) for name in ALL}
        for noise, by_track in outcome.items()
    }
    file = draw.reliability(out / "reliability.png", pooled, TRUE_CLASS)
    return [*found, Figure("Reliability", "Over all views of the three tracks; 15 bins.", file)]


def _problem(name: str, track: Array, seed: int, jobs: int) -> Problem:
    index = tuple(THESIS).index(name)
    samples = measure(Subject(CLASSES[TRUE_CLASS]), track, (seed, 6, index), jobs, f"{name} track")
    return Problem(name, track, [Scores.of(view) for view in samples])


def _repeated(
    trained: TrainedModels,
    noise: TestNoise,
    problem: Problem,
    sigma_m: float,
    methods: Sequence[str],
    count: int,
    seed: int,
    jobs: int,
) -> dict[str, Array]:
    """(N, K, C) log posteriors of each method."""
    arguments = [(trained.models, noise, problem, sigma_m, methods, (seed, index)) for index in range(count)]
    done = repeat(realisation, arguments, jobs, f"{problem.name}, {noise}, {100 * sigma_m:.0f} cm")
    return {name: np.stack([each[name] for each in done]) for name in methods}


def _sweep(trained: TrainedModels, problems: Sequence[Problem], quick: bool, seed: int, jobs: int) -> Sweep:
    count = QUICK_REALISATIONS if quick else SWEEP_REALISATIONS
    return {
        problem.name: {
            f"{100 * sigma:.0f}": summaries(
                _repeated(trained, "sigma_n", problem, sigma, SWEPT, count, seed, jobs), TRUE_CLASS
            )
            for sigma in (QUICK_SWEEP_M if quick else SWEEP_M)
        }
        for problem in problems
    }


def _result(
    outcome: Outcome, sweep: Sweep, tracks: Mapping[str, Array], count: int, seed: int, quick: bool
) -> dict[str, Any]:
    test_noise = {
        noise: {"tracks": {name: {"methods": _named(logs)} for name, logs in by_track.items()}}
        for noise, by_track in outcome.items()
    }
    return {
        "study": NAME,
        "seed": seed,
        "config": to_dict(Configuration()),
        "revision": revision(),
        "quick": quick,
        "settings": {"classes": CLASSES, "true_class": CLASSES[TRUE_CLASS], "sigma_m": SIGMA_M, "realisations": count},
        "tracks_m": {name: track.tolist() for name, track in tracks.items()},
        "methods": test_noise["sigma_n"]["tracks"]["hard"]["methods"],
        "methods_are_of": "test_noise sigma_n, hard track",
        "test_noise": test_noise,
        "sweep_cm": sweep,
    }


def _named(logs: Mapping[str, Array]) -> dict[str, dict[str, Any]]:
    found = summaries(logs, TRUE_CLASS)
    found["ours"] = {**found["ours"], "average": "evidence"}
    return found


def _tables(result: Mapping[str, Any]) -> list[Table]:
    found = [
        methods_table(f"{name.capitalize()} track, {NAMES[noise]}", part["methods"], WORDS)
        for noise in TEST_NOISES
        for name, part in result["test_noise"][noise]["tracks"].items()
    ]
    columns = ("track", "sigma [cm]", "method", "correct, final", "overall", "log MGR 95 %, final", "overall", "NLL")
    keys = ("correct_rate_final", "correct_rate_overall", "log_mgr_final_p95", "log_mgr_overall_p95", "nll")
    rows = tuple(
        (track, sigma, WORDS[name], *(number(methods[name][key]) for key in keys))
        for track, by_sigma in result["sweep_cm"].items()
        for sigma, methods in by_sigma.items()
        for name in SWEPT
    )
    return [*found, Table("Sweep of the localisation error (Figs. 3.12, 3.13), test noise sigma_n", columns, rows)]


def _rate_claim(text: str, methods: Methods, more: float, noise: str) -> Claim:
    ours, theirs = (methods[name]["correct_rate_final"] for name in ("ours", "model_based"))
    overall = tuple(methods[name]["correct_rate_overall"] for name in ("ours", "model_based"))
    told = f"final {ours:.2f} against {theirs:.2f}; overall {overall[0]:.3f} against {overall[1]:.3f}"
    holds = ours >= theirs + more and overall[0] >= overall[1] + more
    return Claim(f"{text} ({NAMES[noise]})", REQUIREMENT, "", told, holds)


def _ratio_claim(methods: Methods, noise: str) -> Claim:
    pairs = [
        tuple(methods[name][f"log_mgr_{when}_p95"] for name in ("ours", "model_based")) for when in ("final", "overall")
    ]
    told = "; ".join(f"{number(ours)} against {number(theirs)}" for ours, theirs in pairs)
    holds = all(ours <= 0.5 * theirs for ours, theirs in pairs)
    text = f"Hard track: 95 % of log MGR, final and overall, at most half of Model Based's ({NAMES[noise]})"
    return Claim(text, REQUIREMENT, "1.1 against 48.6; 1.26 against 29.0", told, holds)


def _table_3_2(track: str, methods: Methods, noise: str) -> Claim:
    """Correct rates similar, if slightly higher, with a lower MGR."""
    keys = ("correct_rate_final", "correct_rate_overall", "log_mgr_final_p95", "log_mgr_overall_p95")
    told = "; ".join(
        f"{name.replace('_', ' ')} {', '.join(number(methods[name][key]) for key in keys)}"
        for name in ("model_based", "ours")
    )
    ours, theirs = methods["ours"], methods["model_based"]
    holds = ours[keys[1]] >= theirs[keys[1]] - 0.02 and ours[keys[3]] <= theirs[keys[3]]
    text = f"{track.capitalize()} track: similar correct rates, no greater log MGR ({NAMES[noise]})"
    return Claim(text, "Table 3.2", THESIS[track], told, holds)
