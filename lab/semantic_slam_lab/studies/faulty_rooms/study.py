"""Rooms whose data or whose map are wrong; and rooms without a map: how much exists of what is stated."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.configuration import to_dict
from semantic_slam_lab.repetitions import keyed_generator, own_numbers, repeat
from semantic_slam_lab.studies.faulty_rooms.closed import CONFIGURATIONS, Driven, configuration, driven_room
from semantic_slam_lab.studies.faulty_rooms.existence import Judged, calibration_error, judged_room, reliability
from semantic_slam_lab.studies.faulty_rooms.faults import FAULTS
from semantic_slam_lab.studies.faulty_rooms.pages import claims_of, tables_of
from semantic_slam_lab.studies.result import write_result

NAME = "faulty_rooms"
ROOMS, QUICK_ROOMS = 20, 1
KEYFRAMES, QUICK_KEYFRAMES = 40, 1
OPEN_ROOMS, QUICK_OPEN_ROOMS = 200, 2
OPEN_KEYFRAMES, QUICK_OPEN_KEYFRAMES = 80, 6
OCCASIONS = {"first keyframe": True, "last keyframe": False}


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Draw, drive, judge; returns the files written."""
    rooms, keyframes = (QUICK_ROOMS, QUICK_KEYFRAMES) if quick else (ROOMS, KEYFRAMES)
    tasks = [
        (fault, name, number, keyframes)
        for fault in FAULTS
        for name in CONFIGURATIONS
        for number in own_numbers(seed, rooms, ROOMS)
    ]
    closed = repeat(driven_room, tasks, jobs, "closed rooms")
    count, length = (QUICK_OPEN_ROOMS, QUICK_OPEN_KEYFRAMES) if quick else (OPEN_ROOMS, OPEN_KEYFRAMES)
    judged = repeat(one_open_room, [(number, length, seed) for number in range(count)], jobs, "open rooms")
    by_task: dict[str, dict[str, list[Driven]]] = {fault: {name: [] for name in CONFIGURATIONS} for fault in FAULTS}
    for (fault, name, *_), outcome in zip(tasks, closed, strict=True):
        by_task[fault][name].append(outcome)
    return _written(out, by_task, judged, quick, seed)


def one_open_room(number: int, num_keyframes: int, seed: int) -> Judged:
    """Draw an open room and judge what is said of it."""
    return judged_room(num_keyframes, keyed_generator(NAME, number, seed))


def _written(
    out: Path, closed: dict[str, dict[str, list[Driven]]], judged: Sequence[Judged], quick: bool, seed: int
) -> list[Path]:
    from semantic_slam.pipeline.provenance import revision

    result = {
        "study": NAME,
        "seed": seed,
        "config": to_dict(configuration("known_map")),
        "revision": revision(),
        "quick": quick,
        "closed": {fault: {name: _summary(own) for name, own in rows.items()} for fault, rows in closed.items()},
        "runs": {
            fault: {name: [asdict(one) for one in own] for name, own in rows.items()} for fault, rows in closed.items()
        },
        "open": _existence(judged, seed),
    }
    out.mkdir(parents=True, exist_ok=True)
    return write_result(out, result, claims_of(result), tables_of(result))


def _summary(rows: Sequence[Driven]) -> dict[str, Any]:
    told = [row.first_unexplained for row in rows if row.first_unexplained is not None]
    to_name = [row.is_named for row in rows if row.is_named is not None]
    nameable = [row.is_nameable for row in rows if row.is_nameable is not None]
    return {
        "rooms": len(rows),
        "lost": sum(row.is_lost for row in rows),
        "named": sum(to_name) if to_name else None,
        "nameable": sum(nameable) if nameable else None,
        "sure_and_wrong": sum(row.sure_and_wrong > 0 for row in rows),
        "position_error_m": float(np.median([row.position_error_m for row in rows])),
        "nees": float(np.mean([row.nees for row in rows])),
        "unexplained": len(told),
        "lost_and_unexplained": sum(row.is_lost and row.unexplained > 0 for row in rows),
        "first_unexplained": float(np.median(told)) if told else None,
        "cpu_s": float(np.mean([row.cpu_s for row in rows])),
    }


def _existence(judged: Sequence[Judged], seed: int) -> dict[str, Any]:
    random, occasions = keyed_generator(NAME, "bootstrap", seed), {}
    for name, is_first in OCCASIONS.items():
        bins = reliability([_at(room, is_first) for room in judged], random)
        occasions[name] = {"ece": calibration_error(bins), "bins": [asdict(own) for own in bins]}
    bins = reliability(judged, random)
    return {
        "rooms": len(judged),
        "entries": sum(len(room.stated) for room in judged),
        "ece": calibration_error(bins),
        "bins": [asdict(own) for own in bins],
        "occasions": occasions,
        "rooms_with_ghost": float(np.mean([room.ghosts > 0 for room in judged])),
        "ghosts": sum(room.ghosts for room in judged),
        "ghosts_expected": float(sum(room.ghosts_expected for room in judged)),
    }


def _at(room: Judged, is_first: bool) -> Judged:
    """What was said on one of the occasions."""
    rows = [row for row, own in enumerate(room.is_first) if own == is_first]
    return replace(room, stated=tuple(room.stated[row] for row in rows), exists=tuple(room.exists[row] for row in rows))
