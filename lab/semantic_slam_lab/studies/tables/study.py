"""Rooms with tables that a camera with depth flies over, with a detector's labels: to map them, or lost on a map."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from semantic_slam.configuration import to_dict
from semantic_slam_lab.repetitions import own_numbers, repeat
from semantic_slam_lab.simulation.detectors.detector_words import DetectorFaults
from semantic_slam_lab.simulation.tables import NAMES, OTHERS, Flight
from semantic_slam_lab.studies.result import Claim, Table, required, write_result
from semantic_slam_lab.studies.tables.lost import Settled, lost
from semantic_slam_lab.studies.tables.run import Flown, configuration, flown

NAME = "tables"
ROOMS, QUICK_ROOMS = 10, 1
POSE_DEGREES, OBJECT_DEGREES = 6, 3
BAND = 0.95
WITH_DEPTH, WITHOUT_DEPTH = "as configured", "without depth"
MOST_TIMES = 2.0
"""Error of the path without depth, in that with depth."""
FLIGHTS = {
    WITH_DEPTH: Flight(),
    WITHOUT_DEPTH: Flight(depth=False),
    "odometry three times as bad": Flight(odometry_share=0.06, odometry_floor=(0.009, 0.006)),
    "crowded, detector often wrong": Flight(
        things=30,
        faults=DetectorFaults(confused=0.3, dropped=0.2, alarms_per_frame=0.5, names=(*NAMES, *OTHERS)),
    ),
}
STARTS = {"things that have names": True, "look-alikes": False}

Found = Mapping[str, Sequence[Flown]]  # by flight
Put = Mapping[str, Sequence[Settled]]  # by what is on the map


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Fly over tables; returns the files written."""
    rooms = own_numbers(seed, QUICK_ROOMS if quick else ROOMS, ROOMS)
    told = iter(repeat(flown, [(room, flight) for flight in FLIGHTS.values() for room in rooms], jobs, "flights"))
    found = {name: [next(told) for _ in rooms] for name in FLIGHTS}
    tasks = [(room, named, Flight()) for named in STARTS.values() for room in rooms]
    put_down = iter(repeat(lost, tasks, jobs, "starts"))
    settled = {name: [next(put_down) for _ in rooms] for name in STARTS}
    result = _result(found, quick, seed) | {
        "starts": {name: _summary_of_starts(rows) for name, rows in settled.items()},
        "runs_of_starts": {name: [asdict(row) for row in rows] for name, rows in settled.items()},
    }
    return write_result(out, result, [*claims_of(found), *claims_of_starts(settled)], [_table(found)])


def _result(found: Found, quick: bool, seed: int) -> dict[str, Any]:
    """``result.json`` without its claims."""
    from semantic_slam.pipeline.provenance import revision

    return {
        "study": NAME,
        "seed": seed,
        "config": to_dict(configuration()),
        "revision": revision(),
        "quick": quick,
        "flights": {name: _summary(rows) for name, rows in found.items()},
        "runs": {name: [_plain(row) for row in rows] for name, rows in found.items()},
    }


def _plain(row: Flown) -> dict[str, Any]:
    return {name: None if value != value else value for name, value in asdict(row).items()}


def _summary(rows: Sequence[Flown]) -> dict[str, Any]:
    objects = [row.object_nees for row in rows if np.isfinite(row.object_nees)]
    return {
        "rooms": len(rows),
        "all_right": sum(row.found == row.seen and not row.false for row in rows),
        "seen": sum(row.seen for row in rows),
        "found": sum(row.found for row in rows),
        "false": sum(row.false for row in rows),
        "named_right": sum(row.named_right for row in rows),
        "associated": float(np.mean([row.associated for row in rows])),
        "pose_nees": float(np.mean([row.pose_nees for row in rows])),
        "pose_band": band(POSE_DEGREES, len(rows)),
        "object_nees": float(np.mean(objects)) if objects else None,
        "object_band": band(OBJECT_DEGREES, max(len(objects), 1)),
        "odometry_m": float(np.mean([row.odometry_m for row in rows])),
        "error_m": float(np.mean([row.error_m for row in rows])),
        "cpu_s": float(np.mean([row.cpu_s for row in rows])),
        "slowest_s": max(row.slowest_s for row in rows),
    }


def band(degrees: int, count: int) -> list[float]:
    """In which the mean of so many independent normalised squared errors lies."""
    low, high = chi2.interval(BAND, degrees * count)
    return [float(low) / count, float(high) / count]


def claims_of(found: Found) -> list[Claim]:
    """What a camera in space has to show."""
    claims = []
    for name, rows in found.items():
        told = _summary(rows)
        right = told["all_right"]
        text = f"{name}: every thing once in 9 of 10 rooms"
        claims.append(required(text, f"{right} of {len(rows)}", right >= 0.9 * len(rows)))
        for what in ("pose", "object"):
            mean, (low, high) = told[f"{what}_nees"], told[f"{what}_band"]
            holds = mean is not None and low < mean < high
            text = f"{name}: normalised squared error of one {what} in every room in the 95 % band of its mean"
            claims.append(required(text, "-" if mean is None else f"{mean:.2f} in {low:.2f} to {high:.2f}", holds))
    if WITH_DEPTH in found and WITHOUT_DEPTH in found:
        with_depth, without = (_summary(found[name])["error_m"] for name in (WITH_DEPTH, WITHOUT_DEPTH))
        text = "without depth: error of the path at most twice that with depth"
        claims.append(required(text, f"{without:.3f} m against {with_depth:.3f} m", without <= MOST_TIMES * with_depth))
    return claims


def _summary_of_starts(rows: Sequence[Settled]) -> dict[str, Any]:
    return {
        "rooms": len(rows),
        "right": sum(row.is_right for row in rows),
        "off_m": float(np.mean([row.off_m for row in rows])),
        "error_m": float(np.median([row.error_m for row in rows])),
        "most_wrong": max(row.wrong for row in rows),
        "cpu_s": float(np.mean([row.cpu_s for row in rows])),
        "slowest_s": max(row.slowest_s for row in rows),
    }


def claims_of_starts(settled: Put) -> list[Claim]:
    """What a camera has to show that is put down on a map."""
    claims = []
    for name, rows in settled.items():
        right = sum(row.is_right for row in rows)
        text = f"lost by 3 m and any yaw among {name}: settled right in 9 of 10 rooms"
        claims.append(required(text, f"{right} of {len(rows)}", right >= 0.9 * len(rows)))
    return claims


def _table(found: Found) -> Table:
    columns = (
        "",
        "rooms all right",
        "found",
        "of",
        "false",
        "named right",
        "detections associated right",
        "odometry [m]",
        "estimate [m]",
        "CPU of a flight [s]",
        "slowest keyframe [s]",
    )
    rows = []
    for name, flights in found.items():
        told = _summary(flights)
        counts = [str(told[key]) for key in ("all_right", "found", "seen", "false", "named_right")]
        sizes = [f"{told[key]:.3f}" for key in ("odometry_m", "error_m")]
        rows.append(
            (name, *counts, f"{told['associated']:.4f}", *sizes, f"{told['cpu_s']:.1f}", f"{told['slowest_s']:.2f}")
        )
    return Table("Flights", columns, tuple(rows))
