"""Simulated walks about desks with boxes alone."""

from typing import Any

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "desks"


def lines(results: KeptResults) -> str:
    """A row for each walk."""
    walks = results.results[STUDY]["walks"]
    rows = [_row(float(drift), row) for drift, own in walks.items() for row in own]
    columns = ("drift", "found", "of", "false", "named right", "pair F1", "of annotated", "path", "odometry")
    return table((*columns, "NEES of pose (6)", "keyframes", "CPU", "times real time"), rows)


def _row(drift: float, row: dict[str, Any]) -> tuple[str, ...]:
    counts = [str(row[key]) for key in ("found", "things", "false", "named_right")]
    scores = [value(row["f1"], ".3f"), value(row.get("f1_annotated"), ".3f")]
    errors = [f"{row['ate_m']:.3f} m", f"{row['odometry_ate_m']:.3f} m", f"{row['nees']:.1f}"]
    return (
        f"{drift:.0%}",
        *counts,
        *scores,
        *errors,
        str(row["keyframes"]),
        f"{row['cpu_s']:.0f} s",
        f"{row['times_real']:.2f}",
    )


SECTIONS = (
    Section(
        STUDY,
        "Desks by boxes alone",
        "Simulated: walks of 87 s about two desks with thirty things, with a camera in the hand, a box detector, no"
        " depth and odometry that errs by 1 or 3 % a metre; read by `import_dataset tum_rgbd`. Boxes are what things of"
        " their size span in the picture; their edges err by 4 % of a side, which stays for half a second, by as much"
        " again that comes back whenever a thing is seen from that side, and by 1.5 pixels; four of ten looks at one"
        " find nothing for half a second, 15 % of the names are wrong for a while, and three frames in ten have a false"
        " alarm. The configuration is `config/spatial.yaml`. *Of annotated*: F1 among the detections that are of a"
        " thing; a dash: not kept. Errors of the path are those at the time, from where the walk began.",
        (("Walks", lines),),
    ),
)
