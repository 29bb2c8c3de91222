"""Localisation around an object from odometry and the learned factor alone (Fig. 5.5), for many tracks and objects."""

from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.training.latent.fitting.refinement import RefinementSettings
from semantic_slam_lab.repetitions import repeat
from semantic_slam_lab.studies.ch5.localization_figures import errors_figure, example_figure
from semantic_slam_lab.studies.ch5.models import DEFAULT, FORMULATIONS, WORDS, chosen_goods, known, new, trained
from semantic_slam_lab.studies.ch5.pages import framed, numbers_table
from semantic_slam_lab.studies.ch5.refinement import refinement_numbers
from semantic_slam_lab.studies.ch5.tracks import Located, located
from semantic_slam_lab.studies.result import Claim, Figure, Table, write_result

NAME = "ch5_localization"
OBJECTS, NEW_OBJECTS, TRACKS = 12, 4, 3
REFINED = ("map", DEFAULT)
"""Models whose parameters are refined on all tracks but the last around each object (Eq. 5.20)."""
QUICK_OBJECTS, QUICK_NEW_OBJECTS, QUICK_TRACKS = 3, 1, 2


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, drive, smooth, draw; returns the files written."""
    out.mkdir(parents=True, exist_ok=True)
    names, models = chosen_goods(None), [trained(name) for name in (*FORMULATIONS, DEFAULT)]
    of_all = tuple(name for name in names if all(known(model, [name]) for model in models))
    of_none = tuple(name for name in names if all(new(model, [name]) for model in models))
    old = _spread(of_all, QUICK_OBJECTS if quick else OBJECTS)
    unseen = of_none[: QUICK_NEW_OBJECTS if quick else NEW_OBJECTS]
    tracks = QUICK_TRACKS if quick else TRACKS
    tasks = [(name, number, seed) for name in (*old, *unseen) for number in range(tracks)]
    runs = repeat(located, tasks, jobs, "tracks")
    of_known = [run for run in runs if run.name in old]
    of_new = [run for run in runs if run.name in unseen]
    numbers = {name: _numbers(of_known, of_new, name) for name in (*FORMULATIONS, DEFAULT)}
    config = {"objects": list(old), "new_objects": list(unseen), "tracks_per_object": tracks}
    result = framed(NAME, numbers, config, quick=quick, seed=seed)
    result["tracks"] = [_told(run) for run in runs]
    settings = RefinementSettings(seed=seed)
    result["refinement"] = {name: refinement_numbers(runs, unseen, name, jobs, settings) for name in REFINED}
    median = float(np.median([run.ratio(DEFAULT) for run in of_known]))
    example = min(of_known, key=lambda run: abs(run.ratio(DEFAULT) - median))
    figures = [
        Figure(
            "A track of median gain",
            f"Around {example.name}: true track, dead reckoning from the prior's mean, and the estimate with the"
            " learned factor; right, the error over the track.",
            example_figure(out / "example.png", example, DEFAULT),
        ),
        Figure(
            "All tracks",
            "Mean position error with the learned factor against that of dead reckoning; the line is a third of it.",
            errors_figure(out / "errors.png", of_known, of_new, tuple(numbers)),
        ),
    ]
    tables = [numbers_table("Tracks", numbers), _refinement_table(result["refinement"])]
    return write_result(out, result, [*_claims(numbers), *_refinement_claims(result["refinement"])], tables, figures)


def _spread(names: tuple[str, ...], count: int) -> tuple[str, ...]:
    """So many names, spread over the whole list."""
    chosen = np.linspace(0, len(names) - 1, min(count, len(names))).round().astype(int)
    return tuple(names[index] for index in chosen)


def _numbers(old: list[Located], unseen: list[Located], formulation: str) -> dict[str, float]:
    ratios = np.array([run.ratio(formulation) for run in old])
    given = np.array([run.ratio(f"{formulation}_descriptor_known") for run in old])
    return {
        "median_error_vs_dead_reckoning": float(np.median(ratios)),
        "n_tracks": len(old),
        "n_objects": len({run.name for run in old}),
        "share_of_tracks_improved": float((ratios < 1.0).mean()),
        "share_of_tracks_within_a_third": float((ratios <= 1.0 / 3.0).mean()),
        "median_error_m": float(np.median([run.error_m[formulation].mean() for run in old])),
        "median_dead_reckoning_m": float(np.median([run.error_m["dead_reckoning"].mean() for run in old])),
        "descriptor_known_median_error_vs_dead_reckoning": float(np.median(given)),
        "new_objects_median_error_vs_dead_reckoning": float(np.median([run.ratio(formulation) for run in unseen])),
    }


def _told(run: Located) -> dict[str, Any]:
    errors = {name: float(values.mean()) for name, values in run.error_m.items()}
    return {"object": run.name, "track": run.number, "mean_error_m": errors}


def _claims(numbers: dict[str, dict[str, float]]) -> list[Claim]:
    own = numbers[DEFAULT]
    return [
        Claim(
            "With the learned factor the track is closer to the truth than dead reckoning",
            "Fig. 5.5",
            "one track of one object",
            f"{own['share_of_tracks_improved']:.2f} of {own['n_tracks']} tracks around {own['n_objects']} objects",
            own["share_of_tracks_improved"] > 0.95,
        ),
        Claim(
            "Median track error at most a third of dead reckoning's, the descriptor unknown too",
            "project",
            "",
            ", ".join(f"{WORDS[name]} {row['median_error_vs_dead_reckoning']:.2f}" for name, row in numbers.items()),
            own["median_error_vs_dead_reckoning"] <= 1.0 / 3.0,
        ),
    ]


def _refinement_claims(refinement: dict[str, dict[str, float]]) -> list[Claim]:
    """Whether it helps, and whom."""
    claims = []
    for group in ("trained", "new"):
        told, better = [], []
        for name, row in refinement.items():
            error, likelihood = (
                [row[f"{group}_objects_{when}_{metric}"] for when in ("before", "after")]
                for metric in ("error_vs_dead_reckoning", "log_likelihood_per_view")
            )
            told.append(
                f"{WORDS[name]}: error {error[0]:.2f} to {error[1]:.2f} of dead reckoning's,"
                f" {likelihood[0]:.1f} to {likelihood[1]:.1f} nats a view"
            )
            better.append(error[1] <= error[0] and likelihood[1] >= likelihood[0])
        text = f"Parameters refined with the posterior of other tracks: tracks around {group} objects gain"
        claims.append(Claim(text, "Eq. 5.20", "", "; ".join(told), all(better)))
    return claims


def _refinement_table(refinement: dict[str, dict[str, float]]) -> Table:
    columns = tuple(next(iter(refinement.values())))
    rows = tuple((WORDS[name], *(f"{row[column]:.3g}" for column in columns)) for name, row in refinement.items())
    title = "Parameters refined on all tracks but the last around each object, judged on the last"
    return Table(title, ("model", *(column.replace("_", " ") for column in columns)), rows)
