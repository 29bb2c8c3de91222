"""Live nodes that are sent more than they can use."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "overload"
MOST_ROWS = 12
COLUMNS = {
    "seconds": ("seconds", ".0f"),
    "sent": ("sent", ""),
    "keyframe": ("newest keyframe", ""),
    "late_s": ("its belief is late by", ".1f s"),
    "dropped": ("dropped", ""),
}


def over_time(results: KeptResults) -> str:
    """How much is sent, and a row now and then, the last one among them."""
    rows = results.at(f"{STUDY}:results")
    sent, used = rows[-1]["sent"], rows[-1]["keyframe"] + 1
    told = (
        f"{results.at(f'{STUDY}:rate'):.0f} frames a second are sent, {sent / used:.1f} times as many as are used.\n\n"
    )
    shown = rows[:: -max(1, len(rows) // MOST_ROWS)][::-1]
    nodes = list(shown[0]["resident_mb"])
    cells = [
        (
            *(value(row[key], style) for key, (_, style) in COLUMNS.items()),
            *(value(row["resident_mb"][name], ".0f MB") for name in nodes),
        )
        for row in shown
    ]
    return told + table((*(title for title, _ in COLUMNS.values()), *nodes), cells)


SECTIONS = (
    Section(
        STUDY,
        "More than live nodes can use",
        "A robot drives in a circle among twelve objects without a map; detections that tell places come faster than"
        " they can be used, through classifier, manager and one backend, each a process of its own;"
        " `history.horizon_keyframes` is 200. What is dropped is what the nodes count on"
        " `/diagnostics`; memory is resident.",
        (("", over_time),),
        "python -m semantic_slam_lab.overload --seconds 660 --rate 100 --horizon 200",
    ),
)
