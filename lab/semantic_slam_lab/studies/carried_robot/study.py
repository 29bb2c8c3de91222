"""Ten rooms with a map and ten without: a robot that is carried 3 m or more in mid-drive, or not, and may be or not."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from semantic_slam.configuration import to_dict
from semantic_slam_lab.repetitions import own_numbers, repeat
from semantic_slam_lab.studies.carried_robot.run import DRIVES, Driven, Method, driven, with_values
from semantic_slam_lab.studies.faulty_rooms.closed import configuration
from semantic_slam_lab.studies.result import Claim, Table, required, write_result

NAME = "carried_robot"
ROOMS, QUICK_ROOMS = 10, 1
SOON = 10
NUMBERS = ("noticed", "noticed_soon", "may_be_found", "found", "recognised", "sure_and_wrong", "false_alarms")
MAY_BE, NEVER = ({"revision": {"carried_probability": probability}} for probability in (1e-3, 0.0))
METHODS = {
    "ours": Method(overrides=MAY_BE),
    "never_carried": Method(overrides=NEVER),
    "not_carried": Method(overrides=MAY_BE, is_carried=False),
    "neither": Method(overrides=NEVER, is_carried=False),
}
"""Carried, and it may be; carried, and it believes that it never is; it may be, and is not; neither."""
CASES = [(world, method) for world in DRIVES for method in METHODS]
RECOGNISED = 0.9
"""Share of the detections of what it knew from which on a robot recognises what it sees."""
LEAST_AGAIN = 2
"""Number of objects that it must see again to be found: one may be seen from anywhere around it."""

Found = Mapping[str, Mapping[str, Sequence[Driven]]]  # by world and method


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Drive, be carried, drive on; returns the files written."""
    rooms = own_numbers(seed, QUICK_ROOMS if quick else ROOMS, ROOMS)
    tasks = [(world, METHODS[method], room) for world, method in CASES for room in rooms]
    told = iter(repeat(driven, tasks, jobs, "drives"))
    found: dict[str, dict[str, list[Driven]]] = {world: {} for world in DRIVES}
    for world, method in CASES:
        found[world][method] = [next(told) for _ in rooms]
    return write_result(out, _result(found, quick, seed), claims_of(found), [_table(found)])


def _result(found: Found, quick: bool, seed: int) -> dict[str, Any]:
    """``result.json`` without its claims."""
    from semantic_slam.pipeline.provenance import revision

    return {
        "study": NAME,
        "seed": seed,
        "config": to_dict(with_values(configuration("second_session"), MAY_BE)),
        "revision": revision(),
        "quick": quick,
        "worlds": {world: {name: _summary(rows) for name, rows in own.items()} for world, own in found.items()},
        "runs": {
            world: {name: [_plain(row) for row in rows] for name, rows in own.items()} for world, own in found.items()
        },
    }


def _summary(rows: Sequence[Driven]) -> dict[str, Any]:
    noticed = [row.noticed_after for row in rows if row.noticed_after is not None]
    may_be_found = [row for row in rows if row.seen_again >= LEAST_AGAIN]
    return {
        "rooms": len(rows),
        "noticed": len(noticed),
        "noticed_soon": sum(after < SOON for after in noticed),
        "may_be_found": len(may_be_found),
        "found_of_these": sum(row.found_after is not None for row in may_be_found),
        "found": sum(row.found_after is not None for row in rows),
        "recognised": sum((row.recognised or 0.0) >= RECOGNISED for row in rows),
        "sure_and_wrong": sum(row.is_sure_and_wrong for row in rows),
        "false_alarms": sum(row.false_alarms for row in rows),
        "ended_early": sum(bool(row.fault) for row in rows),
        "cpu_s": sum(row.cpu_s for row in rows) / len(rows),
        "slowest_s": max(row.slowest_s for row in rows),
    }


def _plain(row: Driven) -> dict[str, Any]:
    return asdict(row) | {"error_m": None if row.fault else row.error_m}


def claims_of(found: Found) -> list[Claim]:
    """What a robot that is carried has to show."""
    claims = []
    for world, own in found.items():
        told = _summary(own["ours"])
        cases = (
            (f"noticed within {SOON} keyframes in at least 9 of 10 rooms", "noticed_soon", len(own["ours"])),
            (
                f"found again in at least 9 of 10 rooms where {LEAST_AGAIN} known objects are seen again",
                "found_of_these",
                told["may_be_found"],
            ),
        )
        for text, number, count in cases:
            holds = count > 0 and told[number] >= 0.9 * count
            claims.append(required(f"{world}: {text}", f"{told[number]} of {count}", holds))
    return claims


def _table(found: Found) -> Table:
    columns = (
        "",
        "",
        "noticed",
        f"within {SOON}",
        "may be found",
        "found again",
        "recognises",
        "sure and wrong",
        "false alarms",
        "CPU of a drive [s]",
        "slowest keyframe [s]",
    )
    rows = []
    for world, own in found.items():
        for name, drives in own.items():
            told = _summary(drives)
            counts = [str(told[key]) for key in NUMBERS]
            rows.append((world, name, *counts, f"{told['cpu_s']:.1f}", f"{told['slowest_s']:.2f}"))
    return Table("Rooms", columns, tuple(rows))
