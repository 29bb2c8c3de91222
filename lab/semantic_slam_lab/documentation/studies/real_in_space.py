"""Photographs of a kitchen and of a cabinet, in all six of a hand-held camera's pose."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "real_in_space"
COLUMNS = {
    "num_objects": ("objects", ""),
    "ghosts": ("of these nothing asked for", ""),
    "ate_m": ("path", ".3f m"),
    "odometry_ate_m": ("odometry", ".3f m"),
    "nees_mean": ("NEES of pose (6)", ".1f"),
    "cpu_s": ("CPU", ".1f s"),
}


def lines(results: KeptResults) -> str:
    """A row for each drive and what is known of depth."""
    rows = []
    for name, row in results.results[STUDY]["lines"].items():
        errors = ", ".join(value(own, ".2f") for own in row["errors_m"])
        rows.append((name, errors, *(value(row[key], style) for key, (_, style) in COLUMNS.items())))
    return table(("drive", "errors of objects [m]", *(own for own, _ in COLUMNS.values())), rows)


SECTIONS = (
    Section(
        STUDY,
        "A kitchen and a cabinet in space",
        "RedKitchen (three alike chairs and two mugs, NanoDet's boxes, visual odometry) with depth and by boxes alone,"
        " and a cabinet that is walked about (boxes alone, odometry that errs by 2 %), with `config/spatial.yaml` and"
        " no map. Errors are distances from the median of the boxes' places by depth under the true poses, paths"
        " aligned; for the cabinet from where the rays of its boxes meet.",
        (("Drives", lines),),
    ),
)
