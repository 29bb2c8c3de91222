"""Rooms of identical furniture without a map, with false alarms and misses: the open world against four baselines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from semantic_slam.configuration import OdometryConfiguration, to_dict
from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.aliased_room.data import Rates, Recording, alarms_per_frame, disturbed, record_scene
from semantic_slam_lab.studies.aliased_room.hybrid import drive_with_hybrid_smoother
from semantic_slam_lab.studies.aliased_room.methods import Outcome, configuration_of, drive_with
from semantic_slam_lab.studies.aliased_room.pages import claims_of, figures_of, tables_of
from semantic_slam_lab.studies.aliased_room.scores import Row, score, summary
from semantic_slam_lab.studies.result import write_result

NAME = "aliased_room"
FIRST_ROOM = 1
"""Room 0 is the shipped bag's; the front end was set on rooms 0, 101 and 102."""
ROOMS, QUICK_ROOMS, QUICK_KEYFRAMES = 10, 1, 25
DRAWS, QUICK_DRAWS = 3, 1
METHODS = ("ours", "max_mixture", "nearest_neighbour", "no_semantics", "hybrid_smoother")
STATED = OdometryConfiguration()
SLIPPERY = replace(
    STATED,
    sigma_translation_per_m=3.0 * STATED.sigma_translation_per_m,
    sigma_rotation_per_m=3.0 * STATED.sigma_rotation_per_m,
    sigma_rotation_per_rad=3.0 * STATED.sigma_rotation_per_rad,
)
LINES = {"default": Rates(0.1, 0.1, STATED), "slippery": Rates(0.1, 0.1, SLIPPERY)}
"""10 % of all detections false, 10 % of the true ones missed; with the default odometry's noise, and three times it."""

Lines = Mapping[str, Mapping[str, Sequence[Row]]]
"""Line -> method -> runs."""


@dataclass(frozen=True)
class Task:
    """All runs in one room, which is rendered and measured once for them."""

    room: int
    seed: int
    draws: int
    max_keyframes: int | None


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, drive with every method, compare; returns the files written."""
    count, draws = (QUICK_ROOMS, QUICK_DRAWS) if quick else (ROOMS, DRAWS)
    tasks = [Task(FIRST_ROOM + n, seed, draws, QUICK_KEYFRAMES if quick else None) for n in range(count)]
    found = repeat(runs_in_room, [(task,) for task in tasks], jobs, "rooms")
    return written(out, merged(found), quick, seed)


def runs_in_room(task: Task) -> Lines:
    """Every line, draw and method in one room."""
    recording = record_scene(task.room, task.max_keyframes)
    return merged([one_run(recording, line, task.seed, draw) for draw in range(task.draws) for line in LINES])


def one_run(recording: Recording, line: str, seed: int, draw: int) -> dict[str, dict[str, list[Row]]]:
    """One disturbed drive, the same for every method; odometry errors of the lines differ by their scale alone."""
    rates = LINES[line]
    drive = disturbed(recording, rates, keyed_generator(NAME, recording.scene, seed, draw))
    alarms = alarms_per_frame(recording, rates)
    return {line: {method: [score(_driven(method, drive, rates, alarms), drive, draw)] for method in METHODS}}


def _driven(method: str, drive: Recording, rates: Rates, alarms: float) -> Outcome:
    if method == "hybrid_smoother":
        return drive_with_hybrid_smoother(drive, rates, alarms)
    return drive_with(method, drive, rates, alarms)


def merged(parts: Sequence[Lines]) -> dict[str, dict[str, list[Row]]]:
    """The runs of all parts."""
    return {
        line: {method: [row for part in parts if line in part for row in part[line][method]] for method in METHODS}
        for line in LINES
        if any(line in part for part in parts)
    }


def written(out: Path, lines: Lines, quick: bool, seed: int) -> list[Path]:
    """result.json and its page."""
    from semantic_slam.pipeline.provenance import revision

    summaries = {line: {method: summary(rows) for method, rows in methods.items()} for line, methods in lines.items()}
    methods = {method: dict(row) for method, row in summaries["default"].items()}
    methods["ours"]["method"] = "open world, classes carried, gp_independent"
    result = {
        "study": NAME,
        "seed": seed,
        "config": to_dict(configuration_of("ours", 0.24, LINES["default"].misses)),
        "revision": revision(),
        "quick": quick,
        "rates": {line: to_dict(rates) for line, rates in LINES.items()},
        "num_runs": {line: len(rows["ours"]) for line, rows in lines.items()},
        "methods": methods,
        "lines": summaries,
        "runs": {
            line: {
                method: [{"room": r.scene, "draw": r.draw, **r.metrics, "fault": r.fault} for r in rows]
                for method, rows in found.items()
            }
            for line, found in lines.items()
        },
    }
    out.mkdir(parents=True, exist_ok=True)
    return write_result(out, result, claims_of(result), tables_of(result), figures_of(out, result))
