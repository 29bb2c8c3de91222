"""Nodes that are killed."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "kills"
COLUMNS = {"beliefs": ("beliefs", ""), "of": ("of", ""), "largest_difference": ("largest difference", ".2g")}


def demos(results: KeptResults) -> str:
    """A row for each demo."""
    rows = [
        (
            trial["killed"],
            ", ".join(map(str, trial["at"])),
            *(value(trial[key], own[1]) for key, own in COLUMNS.items()),
        )
        for trial in results.at(f"{STUDY}:trials")
    ]
    return table(("killed", "at keyframes", *(title for title, _ in COLUMNS.values())), rows)


SECTIONS = (
    Section(
        STUDY,
        "Killed nodes",
        "The demo of the shipped bag with two backends. A node is killed at every tenth keyframe, in one demo or, where"
        " it is still down from the last time, in several; then everything at once, the demo, too, at random instants,"
        " after which `demo --resume` goes on. Every number of every belief is compared with those of a demo that is"
        " left in peace.",
        (("", demos),),
        "python -m semantic_slam_lab.kills",
    ),
)
