"""Robots that are lifted in mid-drive and set down elsewhere."""

from collections.abc import Mapping

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.methods_table import Column, MethodsTable
from semantic_slam_lab.documentation.writing.section import Section
from semantic_slam_lab.studies.carried_robot.study import CASES

STUDY = "carried_robot"
METHODS = {
    "ours": "carried",
    "never_carried": "carried, parameter off",
    "not_carried": "not carried",
    "neither": "not carried, parameter off",
}
COLUMNS = (
    Column("rooms", "rooms", "d"),
    Column("noticed", "noticed", "d"),
    Column("within 10", "noticed_soon", "d"),
    Column("may be found", "may_be_found", "d"),
    Column("found again", "found", "d"),
    Column("recognises", "recognised", "d"),
    Column("sure and wrong", "sure_and_wrong", "d"),
    Column("false alarms", "false_alarms", "d"),
    Column("CPU of a drive [s]", "cpu_s", ".1f"),
    Column("slowest keyframe [s]", "slowest_s", ".2f"),
)


def rooms(results: KeptResults) -> str:
    """Rows of the worlds and methods that the kept result has."""
    kept = results.at(f"{STUDY}:worlds")
    assert isinstance(kept, Mapping)
    rows = {
        f"worlds/{world}/{method}": f"{world}, {METHODS[method]}"
        for world, method in CASES
        if method in kept.get(world, ())
    }
    return MethodsTable(study=STUDY, columns=COLUMNS, rows=rows)(results)


SECTIONS = (
    Section(
        STUDY,
        "A robot that is carried",
        "After 20 keyframes on a map, or 40 without one, the robot is lifted and set down 3 m or more away, any"
        " way round, and odometry says that it stood still; 20 or 40 keyframes follow."
        " `revision.carried_probability` is 0.001. Saved map: `config/second_session.yaml`, and, where there are rows"
        " of them, `known_map.yaml` and `default.yaml`, each with the sensor's range of these rooms; own map:"
        " `config/open_world.yaml`. Noticed: the belief says with more than 0.5 that the robot was carried or that"
        " its data are unexplained. May be found: two objects or more that were seen twice before it was carried are"
        " seen twice afterwards; one may be seen from anywhere around it. Found again: to the end within 0.5 m, with"
        " more than 0.5; on its own map, which is bent, of its true place relative to the objects that it knew."
        " Recognises: at the end nine tenths of what it has seen since of what it knew before have their names of"
        " before. Sure and"
        " wrong: at the end one hypothesis has more than 0.9 and excludes the true position (one in a thousand). False"
        " alarms are keyframes in which such is said of a robot that was not carried.",
        (("", rooms),),
    ),
)
