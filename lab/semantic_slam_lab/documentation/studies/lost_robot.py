"""Robots put down on a known map, metres from where they think."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section
from semantic_slam_lab.studies.lost_robot.study import COLUMNS

STUDY = "lost_robot"


def starts(results: KeptResults) -> str:
    """A row for each start."""
    titles = [title for title, _ in COLUMNS.values()]
    rows = [
        (name, *(value(row.get(key), style) for key, (_, style) in COLUMNS.items()))
        for name, row in results.results[STUDY]["starts"].items()
    ]
    return table(("start", *titles), rows)


SECTIONS = (
    Section(
        STUDY,
        "A real robot lost on a known map",
        "Drives of MRCLAM are begun in their middle, with the true places of the landmarks as the map, their numbers"
        " hidden, an initial pose up to 10 m off and any heading, and run until 120 detections of landmarks were made;"
        " the configuration is `config/uncalibrated.yaml`. P(right): weight of the hypotheses that say where the robot"
        " is and are right; wrong ones, at the end and the most before. CPU is that of a keyframe.",
        (("Starts", starts),),
    ),
)
