"""Rooms whose data or whose map are wrong, and what exists of what an open world states."""

from typing import Any

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section
from semantic_slam_lab.studies.faulty_rooms.pages import COLUMNS, row_of

STUDY = "faulty_rooms"


def closed(results: KeptResults) -> str:
    """A lost robot in rooms with a known map."""
    own = _own(results)["closed"]
    return table(COLUMNS, [row_of(fault, name, row) for fault, rows in own.items() for name, row in rows.items()])


def existence(results: KeptResults) -> str:
    """What was stated to exist, when it was first and last stated, and what does."""
    own = _own(results)["open"]
    occasions = {"both": own, **own["occasions"]}
    rows = [
        (name, value(row["mean"], ".2f"), value(row["share"], ".2f"), str(row["count"]), value(row["credible"]))
        for name, occasion in occasions.items()
        for row in occasion["bins"]
    ]
    errors = ", ".join(f"{name} {value(occasion['ece'], '.3f')}" for name, occasion in occasions.items())
    ghosts = (
        f"ECE: {errors}. Of {own['rooms']} rooms {value(own['rooms_with_ghost'], '.0%')} have a ghost at the end;"
        f" {own['ghosts']} objects stated with more than 0.5 are none, by what is stated"
        f" {value(own['ghosts_expected'], '.1f')} would be.\n"
    )
    return table(("keyframe", "stated", "exists", "entries", "credible (99 %)"), rows) + "\n" + ghosts


def _own(results: KeptResults) -> dict[str, Any]:
    return results.results[STUDY]


SECTIONS = (
    Section(
        STUDY,
        "Rooms that are not as the models say",
        "A robot that is lost by 10 m drives 40 keyframes through a room of eight pieces of furniture, three and two of"
        " them alike, past a map of it; one thing is wrong. Lost: in the second half less than nine tenths of the"
        " weight, on average, has the associations right. Named: at the end every object that the map lacks is stated"
        " where it is, and what stands elsewhere is so, too, or said to be moved. Could be: what was displaced would be"
        " named by who is told what each detection is of, and goes by the same models. Sure and wrong: rooms in which"
        " an association in the second half, or a statement at the end, has more than 0.9 and is wrong. Then rooms"
        " without a map, drawn from what `config/open_world.yaml` says: does what is stated exist?",
        (
            ("A known map, and a fault", closed),
            ("No map: existence when an object is first and last stated", existence),
        ),
    ),
)
