"""RedKitchen of 7-Scenes: NanoDet's boxes, depth and visual odometry in, three identical chairs and two mugs out.

The poses that the data set gives level the camera, as an inertial sensor would, and judge; they tell nothing else.
"""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration, to_dict
from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.images_import import write_images
from semantic_slam.datasets.image_folders.journey import journey_by_odometry
from semantic_slam.datasets.image_folders.layouts import read_image_folder
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.pipeline.offline import run_bag
from semantic_slam_lab.repetitions import apart
from semantic_slam_lab.studies.real_drives.drives import data_folder
from semantic_slam_lab.studies.real_kitchen.front_end import front_end
from semantic_slam_lab.studies.real_kitchen.judged import Judged, judged
from semantic_slam_lab.studies.real_kitchen.methods import METHODS, configuration, configuration_of
from semantic_slam_lab.studies.real_kitchen.pages import claims_of, figures_of, tables_of
from semantic_slam_lab.studies.result import write_result
from semantic_slam_lab.studies.victoria_park.methods import StudyPool, smoothed_poses

QUICK_FRAMES = 60


@dataclass(frozen=True)
class Task:
    """One method over the bag."""

    method: str
    bag: Path
    configuration: Configuration


def run(out: Path, *, quick: bool, jobs: int, seed: int, data: Path | None = None) -> list[Path]:
    """Import, map, judge; returns the files written. A quick run takes the first frames. Raises InputError."""
    root = data_folder(data)
    folder = read_image_folder(root / "redkitchen")
    folder = replace(folder, frames=folder.frames[: QUICK_FRAMES if quick else None])
    base = configuration(seed)
    with tempfile.TemporaryDirectory(prefix="real_kitchen_") as place:
        failures = write_bag(folder, root / "weights", Path(place), seed)
        tasks = [Task(method, Path(place) / "bag", configuration_of(method, base)) for method in METHODS]
        runs = dict(zip(METHODS, apart(outcome_of, tasks, jobs, "methods", shared=quick), strict=True))
    result = summary(runs, base, quick, failures)
    return write_result(out, result, claims_of(result), tables_of(runs), figures_of(out, runs))


def write_bag(folder: ImageFolder, weights: Path, place: Path, seed: int) -> int:
    """Write ``place``/bag with visual odometry; in how many frames that failed is returned. Raises InputError."""
    told, odometry = front_end(folder, weights, seed), place / "odometry.txt"
    told.write_odometry(odometry)
    write_images(folder, journey_by_odometry(folder, odometry), told.found, place / "bag")
    return told.failures


def outcome_of(task: Task) -> Judged:
    """Run one method over the bag and judge it."""
    with tempfile.TemporaryDirectory(prefix="real_kitchen_") as place:
        beliefs, pool = Path(place) / "beliefs", StudyPool(1)
        run_bag(task.bag, beliefs, task.configuration, pool=pool)
        record = read_record(beliefs)
    last = record.beliefs[-1]
    component = pool.component(int(last.hypothesis_ids[np.argmax(last.log_weights)]))
    return judged(record, smoothed_poses(component)[:, :3])


def summary(runs: Mapping[str, Judged], base: Configuration, quick: bool, failures: int) -> dict[str, Any]:
    """``result.json`` without its claims; what our method found stands at its top, too."""
    from semantic_slam.pipeline.provenance import revision

    there = runs["ours"].there
    return {
        "study": "real_kitchen",
        "seed": base.seed,
        "config": to_dict(configuration_of("ours", base)),
        "revision": revision(),
        "quick": quick,
        "visual_odometry_failures": failures,
        "detections_of": dict(zip(there.names, there.detections, strict=True)),
        **runs["ours"].metrics,
        "methods": {name: run.metrics for name, run in runs.items()},
    }
