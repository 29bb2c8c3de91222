"""Victoria Park without landmark numbers: the open world against joint assignment and nearest neighbour.

The file's odometry drifts and is far too sure of itself. Its bias is estimated with the poses, and how much larger its
covariance is, hypotheses differ in: evidence decides during the drive. The detections' noise is the file's. Landmark
numbers serve the scores and nothing else. The other methods, of one hypothesis each, are given the covariance that ours
chose.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from semantic_slam.configuration import to_dict
from semantic_slam.datasets.victoria_park import Log, example_path, read_log
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.odometry_bias import bias_sigmas
from semantic_slam_lab.repetitions import apart
from semantic_slam_lab.studies.result import write_result
from semantic_slam_lab.studies.victoria_park.data import Variant, make_drive
from semantic_slam_lab.studies.victoria_park.methods import (
    NUM_HYPOTHESES,
    Outcome,
    configuration_of,
    drive_with,
    one_trunk,
)
from semantic_slam_lab.studies.victoria_park.pages import claims_of, figures_of, tables_of
from semantic_slam_lab.studies.victoria_park.reference import Solution, from_poses, known_association, rms_distance

QUICK_KEYFRAMES = 400
FACTORS = (4.0, 8.0, 16.0, 32.0, 50.0)
"""Factors on the odometry covariance that is given."""
RERUNS, QUICK_RERUNS = 20, 1
RERUNS_OF_OTHERS = 5
"""Reruns of the methods besides ours: nearest neighbour and joint assignment."""
HARD = {
    "dropped_40": Variant(dropped_share=0.4),
    "blind_100m": Variant(blind_m=100.0, blind_every_m=300.0),
}


@dataclass(frozen=True)
class Task:
    """One drive with one method."""

    name: str
    method: str
    variant: Variant


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Drive with every method and variant, compare; returns the files written."""
    base = Variant(seed=seed, num_keyframes=QUICK_KEYFRAMES if quick else None)
    outcomes = _all_of([Task("ours", "ours", base)], jobs, shared=quick)
    factor = outcomes["ours"].metrics["noise_factor"]
    alone = [Task(method, method, _given(method, base, factor)) for method in NUM_HYPOTHESES if method != "ours"]
    outcomes |= _all_of(alone, jobs, shared=quick)
    outcomes |= _all_of(_tasks(base, factor, quick), jobs, shared=True)
    chosen = replace(base, odometry_factor=factor)
    reference = _reference(chosen)
    result = _summary(outcomes, reference, chosen, quick, seed)
    figures = figures_of(out, outcomes, reference.poses)
    return write_result(out, result, claims_of(result), tables_of(result), figures)


def _given(method: str, variant: Variant, factor: float) -> Variant:
    """Methods of one hypothesis cannot choose: they are given what ours chose."""
    return variant if method == "ours" else replace(variant, odometry_factor=factor * variant.odometry_factor)


def _tasks(base: Variant, factor: float, quick: bool) -> list[Task]:
    tasks = []
    for number in range(QUICK_RERUNS if quick else RERUNS):
        for method in NUM_HYPOTHESES if number < RERUNS_OF_OTHERS else ("ours",):
            variant = replace(base, dropped_share=0.1, seed=base.seed + 1 + number)
            tasks.append(Task(f"dropped_10/{number}/{method}", method, _given(method, variant, factor)))
    for given in (4.0, 50.0) if quick else FACTORS:
        tasks.append(Task(f"factor/{given:g}", "ours", replace(base, odometry_factor=given)))
    for name, hard in HARD.items():
        for method in NUM_HYPOTHESES:
            variant = replace(hard, num_keyframes=base.num_keyframes, seed=base.seed)
            tasks.append(Task(f"{name}/{method}", method, _given(method, variant, factor)))
    return tasks


def _all_of(tasks: list[Task], jobs: int, *, shared: bool) -> dict[str, Outcome]:
    outcomes = apart(outcome_of, tasks, jobs, "drives", shared=shared)
    return {task.name: outcome for task, outcome in zip(tasks, outcomes, strict=True)}


def outcome_of(task: Task) -> Outcome:
    """Make the drive, run the method."""
    return drive_with(task.method, make_drive(_log(), task.variant))


@cache
def _log() -> Log:
    return read_log(example_path())


def _reference(variant: Variant) -> Solution:
    return known_association(make_drive(_log(), variant), variant.landmark_variance_m2, _bias_sigmas())


def _bias_sigmas() -> Array:
    return bias_sigmas(configuration_of("ours").odometry)


def _summary(
    outcomes: dict[str, Outcome], reference: Solution, base: Variant, quick: bool, seed: int
) -> dict[str, Any]:
    from semantic_slam.pipeline.provenance import revision

    drive = make_drive(_log(), base)
    noise_of_all = (base.landmark_variance_m2, _bias_sigmas())
    merged = from_poses(drive, one_trunk(drive.labels), *noise_of_all, reference.poses)
    methods: dict[str, dict[str, Any]] = {}
    for method in NUM_HYPOTHESES:
        outcome = outcomes[method]
        own = from_poses(drive, outcome.associations, *noise_of_all, outcome.poses)
        methods[method] = {
            **outcome.metrics,
            "rms_to_known_association_m": rms_distance(outcome.poses, reference.poses),
            "rms_to_merged_association_m": rms_distance(outcome.poses, merged.poses),
            "cost_under_own_associations": own.cost,
            "fault": outcome.fault,
        }
    methods["ours"]["method"] = "open world, 10 hypotheses"
    others = {name: {**outcome.metrics, "fault": outcome.fault} for name, outcome in outcomes.items() if "/" in name}
    return {
        "study": "victoria_park",
        "seed": seed,
        "config": to_dict(configuration_of("ours")),
        "revision": revision(),
        "quick": quick,
        "noise": {
            "odometry_factor": base.odometry_factor,
            "landmark_variance_m2": base.landmark_variance_m2,
            "chosen_by": "evidence during the drive, landmark numbers unseen; the landmark variance is the file's",
        },
        "num_keyframes": len(drive.keyframes),
        "known_association_cost": reference.cost,
        "merged_association_cost": merged.cost,
        "known_association_real_time_factor": drive.duration_s / reference.seconds,
        "methods": methods,
        "dropped_10": _runs(others, "dropped_10/"),
        "odometry_factors": _runs(others, "factor/"),
        **{name: _runs(others, f"{name}/") for name in HARD},
    }


def _runs(others: dict[str, dict[str, Any]], prefix: str) -> dict[str, dict[str, Any]]:
    return {name.removeprefix(prefix): row for name, row in others.items() if name.startswith(prefix)}
