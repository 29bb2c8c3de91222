"""Real pictures of a hand-held camera in all six: a kitchen with depth and without, a cabinet by its boxes alone."""

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.configuration import to_dict
from semantic_slam.datasets.image_folders.images_in_space import with_places
from semantic_slam.datasets.image_folders.layouts import read_image_folder
from semantic_slam.datasets.space.levelling import OPTICAL
from semantic_slam.perception.frame import Detections
from semantic_slam_lab.repetitions import apart
from semantic_slam_lab.studies.real_drives.drives import data_folder
from semantic_slam_lab.studies.real_in_space import bags
from semantic_slam_lab.studies.real_in_space.reference import meeting_point, places
from semantic_slam_lab.studies.real_in_space.run import Task, configuration, outcome_of
from semantic_slam_lab.studies.real_kitchen.reference import COUNTS, agreed_places
from semantic_slam_lab.studies.result import Claim, Table, required, write_result

QUICK_FRAMES = 60
WITH_DEPTH, ALONE, CABINET = "kitchen, depth", "kitchen, boxes alone", "cabinet, boxes alone"
LARGEST_M = {WITH_DEPTH: 0.07, ALONE: 0.15, CABINET: 0.10}
IN_KITCHEN = sum(COUNTS.values())
THINGS = {WITH_DEPTH: IN_KITCHEN, ALONE: IN_KITCHEN, CABINET: 1}
"""How many are there, whether or not the reference tells where."""


def run(out: Path, *, quick: bool, jobs: int, seed: int, data: Path | None = None) -> list[Path]:
    """Import, map, judge; returns the files written. A quick run takes the first frames. Raises InputError."""
    root = data_folder(data)
    with tempfile.TemporaryDirectory(prefix="real_in_space_") as place:
        tasks = {**_kitchen(root, Path(place), quick, seed), **_cabinet(root, Path(place), seed)}
        runs = dict(zip(tasks, apart(outcome_of, list(tasks.values()), jobs, "bags", shared=quick), strict=True))
    result = _result(runs, to_dict(configuration(tasks[WITH_DEPTH])), quick, seed)
    return write_result(out, result, claims_of(runs), [_table(runs)])


def _kitchen(root: Path, place: Path, quick: bool, seed: int) -> dict[str, Task]:
    folder = read_image_folder(root / "redkitchen")
    folder = replace(folder, frames=folder.frames[: QUICK_FRAMES if quick else None])
    drive, found = bags.kitchen(folder, root / "weights", place, seed)
    placed = with_places(folder, found)
    there = [
        (name, at) for name, count in COUNTS.items() for at, _ in agreed_places(places(drive, placed, name), count)
    ]
    names, positions = tuple(name for name, _ in there), np.array([at for _, at in there]).reshape(-1, 3)
    tasks = {}
    for name, frames in ((WITH_DEPTH, placed), (ALONE, found)):
        tasks[name] = Task(place / name, tuple(COUNTS), names, positions, seed)
        bags.write(folder, drive, frames, tasks[name].bag)
    return tasks


def _cabinet(root: Path, place: Path, seed: int) -> dict[str, Task]:
    folder = read_image_folder(root / "cabinet_58")
    drive, found = bags.cabinet(folder, seed)
    frames: list[Detections] = found
    point = meeting_point(drive, frames, folder.camera, OPTICAL)
    task = Task(place / CABINET, (), ("",), point[None], seed)
    bags.write(folder, drive, frames, task.bag)
    return {CABINET: task}


def _result(runs: Mapping[str, dict[str, Any]], config: dict[str, Any], quick: bool, seed: int) -> dict[str, Any]:
    from semantic_slam.pipeline.provenance import revision

    return {
        "study": "real_in_space",
        "seed": seed,
        "config": config,
        "revision": revision(),
        "quick": quick,
        "lines": dict(runs),
    }


def claims_of(runs: Mapping[str, dict[str, Any]]) -> list[Claim]:
    """What has to be found, and how near."""
    claims = []
    for name, told in runs.items():
        errors, most = told["errors_m"], LARGEST_M[name]
        found = ", ".join("missing" if error is None else f"{error:.3f}" for error in errors)
        measured = f"{found} m" if len(errors) == THINGS[name] else f"{len(errors)} of {THINGS[name]} asked for"
        holds = len(errors) == THINGS[name] and all(error is not None and error <= most for error in errors)
        claims.append(required(f"{name}: each within {most:.2f} m", measured, holds))
        claims.append(required(f"{name}: nothing else", f"{told['ghosts']} others", told["ghosts"] == 0))
        ate, odometry = told["ate_m"], told["odometry_ate_m"]
        claims.append(required(f"{name}: path no worse than odometry", f"{ate:.3f}, {odometry:.3f} m", ate <= odometry))
    return claims


def _table(runs: Mapping[str, dict[str, Any]]) -> Table:
    keys = ("num_objects", "ghosts", "num_keyframes", "ate_aligned_m", "ate_m", "odometry_ate_m", "nees_mean", "cpu_s")
    rows = tuple((name, *(_cell(told[key]) for key in keys)) for name, told in runs.items())
    return Table("Runs", ("", *keys), rows)


def _cell(value: float | int) -> str:
    return str(value) if isinstance(value, int) else f"{value:.3f}"
