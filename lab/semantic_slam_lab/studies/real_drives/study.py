"""Real drives, numbers of the landmarks hidden, under the one configuration for a robot that nobody calibrated.

Every method runs offline over the same bags. Ours chooses the noise of odometry by evidence; the others, which cannot,
are given what it chose on the same drive. The truth serves the scores and nothing else.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from semantic_slam.configuration import Configuration, to_dict
from semantic_slam_lab.repetitions import apart
from semantic_slam_lab.studies.real_drives.claims import claims_of
from semantic_slam_lab.studies.real_drives.drives import Drive, chosen_drives, data_folder
from semantic_slam_lab.studies.real_drives.methods import (
    OURS,
    checked,
    configuration,
    missing,
    offered,
    suits,
)
from semantic_slam_lab.studies.real_drives.pages import figures_of, tables_of
from semantic_slam_lab.studies.real_drives.run import Outcome, Task, outcome_of
from semantic_slam_lab.studies.real_drives.scores import EVERY_METRIC
from semantic_slam_lab.studies.result import write_result

QUICK_KEYFRAMES = 16

Outcomes = dict[tuple[str, str], Outcome]
"""(drive, method) -> what came of it."""


def run(
    out: Path,
    *,
    quick: bool,
    jobs: int,
    seed: int,
    data: Path | None = None,
    drives: list[str] | None = None,
    methods: list[str] | None = None,
    everything: bool = False,
) -> list[Path]:
    """Run ``methods`` over ``drives`` (None: all that ``data`` holds); returns the files written. Raises InputError.

    A quick run takes the first keyframes of the first drive of each kind.
    """
    base = configuration(seed)
    names = checked(methods or offered(base, everything), base)
    chosen = chosen_drives(data_folder(data), drives)
    if quick and drives is None:
        chosen = list({drive.kind: drive for drive in reversed(chosen)}.values())[::-1]
    outcomes = run_all(chosen, names, base, jobs, quick=quick)
    result = summary(outcomes, base, quick)
    return write_result(
        out, result, claims_of(result["drives"]), tables_of(result["drives"]), figures_of(out, outcomes)
    )


def run_all(
    drives: Sequence[Drive], methods: Sequence[str], base: Configuration, jobs: int, *, quick: bool
) -> Outcomes:
    """Ours on every drive first, whose noise the others are then given."""
    max_keyframes = QUICK_KEYFRAMES if quick else None
    first = [Task(drive=drive, method=OURS, base=base, max_keyframes=max_keyframes) for drive in drives]
    outcomes = _side_by_side(first, jobs, "ours", quick)
    rest = [
        Task(
            drive=drive,
            method=method,
            base=base,
            chosen=outcomes[drive.name, OURS].chosen,
            max_keyframes=max_keyframes,
        )
        for drive in drives
        for method in methods
        if method != OURS and suits(method, drive)
    ]
    outcomes |= _side_by_side(rest, jobs, "others", quick)
    order = [(drive.name, method) for drive in drives for method in methods]
    return {key: outcomes[key] for key in order if key in outcomes}


def _side_by_side(tasks: list[Task], jobs: int, words: str, shared: bool) -> Outcomes:
    found = apart(outcome_of, tasks, jobs, words, shared=shared)
    return {(task.drive.name, task.method): outcome for task, outcome in zip(tasks, found, strict=True)}


def summary(outcomes: Outcomes, base: Configuration, quick: bool) -> dict[str, Any]:
    """``result.json`` without its claims."""
    from semantic_slam.pipeline.provenance import revision

    drives: dict[str, Any] = {}
    for (drive, method), outcome in outcomes.items():
        row = {**dict.fromkeys(EVERY_METRIC), **outcome.metrics, **({"fault": outcome.fault} if outcome.fault else {})}
        drives.setdefault(drive, {"methods": {}})["methods"][method] = row
    return {
        "study": "real_drives",
        "seed": base.seed,
        "config": to_dict(base),
        "revision": revision(),
        "quick": quick,
        "not_in_this_version": missing(base),
        "drives": drives,
    }
