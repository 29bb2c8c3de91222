"""Real drives: robots that nobody calibrated, landmark numbers hidden."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.methods_table import Column
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "real_drives"
METHODS = {
    "ours": "open world",
    "one_hypothesis": "one hypothesis (max-mixture)",
    "jcbb": "joint compatibility (JCBB)",
    "nearest_neighbour": "nearest neighbour",
    "given": "numbers given",
    "batch_cauchy": "numbers given, robust batch",
}
PATH = (Column("ATE", "ate_aligned_m", ".2f m"), Column("odometry's ATE", "dead_reckoning_ate_aligned_m", ".2f m"))
POSE = (
    Column("NEES", "nees_mean", ".1f"),
    Column("95 % region holds", "region95_held", ".0%"),
    Column("its radius", "region95_median_radius_m", ".2f m"),
    Column("log density", "log_density", ".1f"),
)
PAIRS = (
    Column("F1", "association_f1", ".3f"),
    Column("F1 of annotated", "association_f1_annotated", ".3f"),
    Column("F1 / ceiling", "f1_of_ceiling", ".2f"),
    Column("F1 of clusters", "association_f1_clusters", ".3f"),
    Column("right of P ≥ 0.9", "pair_right_at_90", ".2f"),
    Column("ECE of pairs", "pair_ece", ".3f"),
)
OBJECTS = (
    Column("objects", "num_objects", ".0f"),
    Column("true ones", "num_true_objects", ".0f"),
    Column("duplicates", "duplicates", ".0f"),
    Column("ghosts", "ghosts", ".0f"),
)
TIME = (Column("CPU", "cpu_s", ".0f s"),)
OTHERS = (Column("parked cars found", "parked_recall", ".0%"), Column("movers called moving", "moving_recall", ".0%"))

Drives = Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]


def each_drive(results: KeptResults) -> str:
    """Our method, a row for each drive."""
    columns = (*PATH, *POSE, *PAIRS, *OBJECTS, *OTHERS, *TIME)
    rows = [[drive, *_cells(own["methods"]["ours"], columns)] for drive, own in _drives(results).items()]
    return table(("drive", *(column.heading for column in columns)), rows)


def robots(results: KeptResults) -> str:
    """Every method, means over the robots of MRCLAM."""
    columns = (*PATH, *POSE[:2], *PAIRS, *OBJECTS, *TIME)
    own = [drive["methods"] for name, drive in _drives(results).items() if name.startswith("mrclam")]
    rows = []
    for method, words in METHODS.items():
        runs = [methods[method] for methods in own if method in methods]
        if runs:
            rows.append([words, *_cells(_means(runs, columns), columns)])
    return table((f"mean over {len(own)} robots", *(column.heading for column in columns)), rows)


def errors(results: KeptResults) -> str:
    """ATE of every method on every drive whose poses are known."""
    return _by_method(results, PATH[0])


def pairs(results: KeptResults) -> str:
    """Pairwise F1 of every method on every drive."""
    return _by_method(results, PAIRS[0])


def _by_method(results: KeptResults, column: Column) -> str:
    """One metric, drives below each other and methods side by side."""
    rows = []
    for name, drive in _drives(results).items():
        known = {method: row.get(column.key) for method, row in drive["methods"].items()}
        if any(found is not None for found in known.values()):
            rows.append([name, *(value(known.get(method), column.style) for method in METHODS)])
    return table((column.heading, *METHODS.values()), rows)


def _drives(results: KeptResults) -> Drives:
    drives: Drives = results.results[STUDY]["drives"]
    return drives


def _cells(row: Mapping[str, Any], columns: tuple[Column, ...]) -> list[str]:
    return [value(row.get(column.key), column.style) for column in columns]


def _means(runs: list[Mapping[str, Any]], columns: tuple[Column, ...]) -> dict[str, float | None]:
    """Mean over the runs in which a metric is known; None where it is in none."""
    found: dict[str, float | None] = {}
    for column in columns:
        known = [run[column.key] for run in runs if run.get(column.key) is not None]
        found[column.key] = float(np.mean(known)) if known else None
    return found


SECTIONS = (
    Section(
        STUDY,
        "Real drives, nobody calibrated the robot",
        "Robots of MRCLAM among landmarks in clusters of two or three, 0.15 to 0.25 m apart; the DLR drive over 576"
        " floor markers; cars of KITTI tracking. One configuration, `config/uncalibrated.yaml`, and no number in it was"
        " chosen with the truth; the methods below ours are given the odometry noise that ours chose. Clusters: true"
        " landmarks in chains of at most 0.5 m; *duplicates*: objects beyond the true ones of their cluster; *ghost*:"
        " an object farther than 1 m from every true one after alignment (KITTI: without any label within 1.5 m of its"
        " detections); *ceiling*: pairwise F1 of a one-to-one matcher frame by frame that is told the true pose and"
        " landmarks; *of annotated*: among the detections that have a true landmark. NEES is of the pose at its time,"
        " unaligned, 3 when consistent; a dash: not known.",
        (
            ("Drive by drive, ours", each_drive),
            ("MRCLAM, every method", robots),
            ("Errors of the paths", errors),
            ("Pairs of detections", pairs),
        ),
    ),
)
