"""A second session in rooms where two objects were moved, one is gone and one is new: what do their maps say?"""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from semantic_slam.configuration import load_configuration, to_dict
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.repetitions import repeat
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Table, write_result
from semantic_slam_lab.studies.second_session.sessions import STARTS, Judged, sessions

ROOMS, QUICK_ROOMS = 10, 1
"""Room 0 is the shipped bag's."""
SURE = 0.9

Rooms = Mapping[int, Mapping[str, Judged]]


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render both sessions of every room, drive, compare; returns the files written."""
    from semantic_slam.pipeline.provenance import revision

    numbers = list(range(QUICK_ROOMS if quick else ROOMS))
    rooms = dict(zip(numbers, repeat(sessions, [(number, seed) for number in numbers], jobs, "rooms"), strict=True))
    result = {
        "study": "second_session",
        "seed": seed,
        "config": to_dict(load_configuration(configuration_file("second_session"))),
        "config_without_map": to_dict(load_configuration(configuration_file("open_world"))),
        "revision": revision(),
        "quick": quick,
        "summary": {start: _summary(rooms, start) for start in STARTS},
        "rooms": {str(n): {start: asdict(own) for start, own in room.items()} for n, room in rooms.items()},
    }
    return write_result(out, result, claims_of(rooms), [_table(rooms)])


def is_right(told: Judged) -> bool:
    """All four named surely, and nothing else."""
    return told.least >= SURE and told.wrong == 0


def _summary(rooms: Rooms, start: str) -> dict[str, float]:
    """How many rooms are right, and how sure the least sure of the four is in the shipped one."""
    right = sum(is_right(room[start]) for room in rooms.values())
    return {"rooms": len(rooms), "rooms_right": right, "shipped_least_probability": rooms[0][start].least}


def claims_of(rooms: Rooms) -> list[Claim]:
    """What is required of the shipped room, and how the others fare."""
    claims = []
    for start in STARTS:
        shipped, right = rooms[0][start], _summary(rooms, start)["rooms_right"]
        claims += [
            Claim(
                f"Shipped room, {start.replace('_', ' ')}: two displaced, one gone, one new, P >= 0.9, no other",
                REQUIREMENT,
                "",
                f"least probability {shipped.least:.3f}, {shipped.wrong} wrong",
                is_right(shipped),
            ),
            Claim(
                f"The same, {start.replace('_', ' ')}, in 8 of 10 rooms",
                "project",
                "",
                f"{right} of {len(rooms)} rooms",
                right >= 0.8 * len(rooms),
            ),
        ]
    return claims


def _table(rooms: Rooms) -> Table:
    rows = [
        (
            f"{number}, {start.replace('_', ' ')}",
            *(f"{value:.3f}" for value in (*told.displaced, told.gone, told.new)),
            str(told.wrong),
            "–" if told.place_error_m is None else f"{told.place_error_m:.2f}",
        )
        for number, room in rooms.items()
        for start, told in room.items()
    ]
    titles = ("room", "P(displaced)", "P(displaced)", "P(gone)", "P(new)", "said wrongly", "displaced ones off by [m]")
    return Table("Rooms", titles, tuple(rows))
