"""Robots of MRCLAM put down on a known map ten metres from where they think, heading unknown, numbers hidden.

The truth tells where the landmarks of the map are, and judges; the configuration is that for a robot that nobody
calibrated, but for the initial pose.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.configuration import to_dict
from semantic_slam_lab.repetitions import apart
from semantic_slam_lab.studies.lost_robot.run import Task, metrics_of
from semantic_slam_lab.studies.lost_robot.starts import starts_of
from semantic_slam_lab.studies.real_drives.drives import MRCLAM, chosen_drives, data_folder
from semantic_slam_lab.studies.real_drives.methods import configuration
from semantic_slam_lab.studies.real_drives.scores import Metrics
from semantic_slam_lab.studies.result import Claim, Table, required, write_result

MOST_DETECTIONS, QUICK_DETECTIONS = 120, 32
COLUMNS = {
    "right_clusters": ("right clusters", ".0%"),
    "ate_m": ("ATE on the map [m]", ".2f"),
    "ate_aligned_m": ("aligned [m]", ".2f"),
    "right_probability": ("P(right)", ".3f"),
    "wrong_probability": ("P(wrong)", ".3f"),
    "most_wrong_probability": ("the most before", ".3f"),
    "sure_after_detections": ("sure after", ".0f"),
    "num_keyframes": ("keyframes", ".0f"),
    "cpu_p95_s": ("CPU, 95 % [s]", ".2f"),
    "cpu_max_s": ("most [s]", ".2f"),
}

Rows = Mapping[str, Metrics]


def run(
    out: Path, *, quick: bool, jobs: int, seed: int, data: Path | None = None, drives: list[str] | None = None
) -> list[Path]:
    """Run every start of ``drives`` (None: all MRCLAM drives below ``data``); returns the files. Raises InputError.

    A quick run takes the first start of the first drive, and few of the detections.
    """
    base = configuration(seed)
    chosen = [drive for drive in chosen_drives(data_folder(data), drives) if drive.kind == MRCLAM]
    starts = [start for drive in chosen for start in starts_of(drive)][: 1 if quick else None]
    most = QUICK_DETECTIONS if quick else MOST_DETECTIONS
    tasks = [Task(start=start, base=base, seed=seed, most_detections=most) for start in starts]
    found = apart(metrics_of, tasks, jobs, "starts", shared=quick)
    rows = {start.name: row for start, row in zip(starts, found, strict=True)}
    return write_result(out, _summary(rows, seed, to_dict(base), quick), claims_of(rows), [_table(rows)])


def _summary(rows: Rows, seed: int, config: dict[str, Any], quick: bool) -> dict[str, Any]:
    """``result.json`` without its claims."""
    from semantic_slam.pipeline.provenance import revision

    whole = {"study": "lost_robot", "seed": seed, "config": config, "revision": revision(), "quick": quick}
    return whole | {"starts": dict(rows)}


def claims_of(rows: Rows) -> list[Claim]:
    """What a lost robot has to show."""
    right = [_is_right(row) for row in rows.values()]
    wrong = max(_values(rows, "most_wrong_probability"))
    p95, most = max(_values(rows, "cpu_p95_s")), max(_values(rows, "cpu_max_s"))
    return [
        required("At least 20 starts", f"{len(rows)}", len(rows) >= 20),
        required(
            "Right cluster and ATE ≤ 0.5 m in at least 90 %", f"{np.mean(right):.0%}", float(np.mean(right)) >= 0.9
        ),
        required("Wrong with P > 0.9 after any keyframe in none", f"at most {wrong:.3f}", wrong <= 0.9),
        required("A keyframe takes at most 1 s at the 95th percentile", f"at most {p95:.2f} s", p95 <= 1.0),
        required("A keyframe takes at most 3 s", f"at most {most:.2f} s", most <= 3.0),
    ]


def _is_right(row: Metrics) -> bool:
    clusters, ate = row["right_clusters"], row["ate_m"]
    return clusters is not None and ate is not None and clusters >= 0.9 and ate <= 0.5


def _values(rows: Rows, name: str) -> list[float]:
    return [float(row[name] or 0.0) for row in rows.values()]


def _table(rows: Rows) -> Table:
    titles, styles = zip(*COLUMNS.values(), strict=True)
    cells = [
        (name, *(_cell(row.get(key), style) for key, style in zip(COLUMNS, styles, strict=True)))
        for name, row in rows.items()
    ]
    return Table("Starts", ("", *titles), tuple(cells))


def _cell(value: float | None, style: str) -> str:
    return "–" if value is None else format(value, style)
