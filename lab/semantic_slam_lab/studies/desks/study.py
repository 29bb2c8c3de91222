"""Walks about desks with a camera in the hand, boxes alone and odometry that drifts: 30 things to be found."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from semantic_slam.configuration import to_dict
from semantic_slam_lab.repetitions import own_numbers, repeat
from semantic_slam_lab.simulation.desks import Office
from semantic_slam_lab.studies.desks.run import Walked, configuration, walked
from semantic_slam_lab.studies.result import Claim, Table, required, write_result

NAME = "desks"
DRIFTS = (0.01, 0.03)
WALKS, QUICK_WALKS = 3, 1
QUICK = Office(seconds=3.0, things=12)
"""A quick run's walk: a few steps before a few things."""
LEAST_FOUND, LEAST_F1, NEES, REAL_TIME = 20, 0.9, (0.5, 9.0), 5.0

Found = Mapping[float, Sequence[Walked]]  # by drift


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Walk; returns the files written. A quick run walks a few steps before a few things."""
    office = QUICK if quick else Office()
    seeds = own_numbers(seed, QUICK_WALKS if quick else WALKS, WALKS)
    told = iter(repeat(walked, [(number, drift, office) for drift in DRIFTS for number in seeds], jobs, "walks"))
    found = {drift: [next(told) for _ in seeds] for drift in DRIFTS}
    from semantic_slam.pipeline.provenance import revision

    result = {
        "study": NAME,
        "seed": seed,
        "config": to_dict(configuration(seed)),
        "revision": revision(),
        "quick": quick,
        "walks": {f"{drift:g}": [asdict(row) for row in rows] for drift, rows in found.items()},
    }
    return write_result(out, result, claims_of(found), [_table(found)])


def claims_of(found: Found) -> list[Claim]:
    """What a walk has to show, for each drift; the worst walk counts."""
    claims = []
    for drift, rows in found.items():
        name, share = f"drift {drift:.0%}", 1.0 if drift <= DRIFTS[0] else 0.5
        things, f1 = min(row.found for row in rows), min(row.f1 for row in rows)
        claims.append(required(f"{name}: {LEAST_FOUND} things or more", f"{things}", things >= LEAST_FOUND))
        claims.append(required(f"{name}: F1 of {LEAST_F1} or more", f"{f1:.3f}", f1 >= LEAST_F1))
        worst = max(row.ate_m / row.odometry_ate_m for row in rows)
        text = f"{name}: error of the path at most {share:g} of odometry's"
        claims.append(required(text, f"{worst:.2f}", worst <= share))
        nees = [row.nees for row in rows]
        holds = min(nees) >= NEES[0] and max(nees) <= NEES[1]
        text = f"{name}: mean normalised squared error of the pose in {NEES[0]:g} to {NEES[1]:g}"
        claims.append(required(text, ", ".join(f"{value:.1f}" for value in nees), holds))
        speed = min(row.times_real for row in rows)
        claims.append(required(f"{name}: {REAL_TIME:g} times real time", f"{speed:.2f}", speed >= REAL_TIME))
    return claims


def _table(found: Found) -> Table:
    columns = ("drift", "things", "found", "false", "named right", "F1", "F1 of annotated", "path [m]", "odometry [m]")
    rows = []
    for drift, walks in found.items():
        counts = [f"{np.mean([getattr(row, key) for row in walks]):.1f}" for key in ("found", "false", "named_right")]
        names = ("f1", "f1_annotated", "ate_m", "odometry_ate_m")
        sizes = [f"{np.mean([getattr(row, key) for row in walks]):.3f}" for key in names]
        times = [f"{np.mean([getattr(row, key) for row in walks]):.1f}" for key in ("nees", "cpu_s")]
        rows.append((f"{drift:.0%}", str(walks[0].things), *counts, *sizes, *times))
    return Table("Walks", (*columns, "NEES", "CPU [s]"), tuple(rows))
