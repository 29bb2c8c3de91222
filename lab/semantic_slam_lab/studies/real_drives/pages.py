"""Tables and pictures of the drives."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.real_drives.run import Outcome
from semantic_slam_lab.studies.real_drives.scores import GHOST_M
from semantic_slam_lab.studies.result import Figure, Table

COLUMNS = {
    "ate_aligned_m": ("ATE [m]", ".2f"),
    "dead_reckoning_ate_aligned_m": ("odometry's [m]", ".2f"),
    "rpe_m_per_m": ("RPE [m/m]", ".3f"),
    "association_f1": ("F1", ".3f"),
    "association_f1_annotated": ("F1 of annotated", ".3f"),
    "f1_of_ceiling": ("of ceiling", ".2f"),
    "association_f1_clusters": ("F1 of clusters", ".3f"),
    "num_objects": ("objects", ".0f"),
    "num_true_objects": ("true ones", ".0f"),
    "duplicates": ("duplicates", ".0f"),
    "ghosts": ("ghosts", ".0f"),
    "gospa_m": ("GOSPA [m]", ".2f"),
    "nees_mean": ("NEES", ".1f"),
    "region95_held": ("95 % region holds", ".2f"),
    "region95_median_radius_m": ("its radius [m]", ".2f"),
    "log_density": ("log density", ".2f"),
    "pair_right_at_90": ("right of P ≥ 0.9", ".2f"),
    "pair_ece": ("ECE of pairs", ".3f"),
    "labelled_pair_right_at_90": ("of labelled pairs", ".2f"),
    "parked_recall": ("parked found", ".2f"),
    "moving_recall": ("movers called", ".2f"),
    "odometry_factor": ("odometry covariance ×", ".0f"),
    "detection_factor": ("detections' covariance ×", ".1f"),
    "ranges_are_depth": ("ranges are depths", ".0f"),
    "correlated_share": ("repeats", ".2f"),
    "cpu_s": ("CPU [s]", ".0f"),
    "real_time_factor": ("× real time", ".1f"),
}
COLUMNS_OF_PICTURE = 3


def tables_of(drives: Mapping[str, Any]) -> list[Table]:
    """A table for each drive, a row for each method."""
    return [_table(name, drive["methods"]) for name, drive in drives.items()]


def _table(drive: str, methods: Mapping[str, Mapping[str, Any]]) -> Table:
    keys = [key for key in COLUMNS if any(row.get(key) is not None for row in methods.values())]
    rows = tuple(
        (method, *(_cell(row.get(key), COLUMNS[key][1]) for key in keys), row.get("fault", ""))
        for method, row in methods.items()
    )
    return Table(drive, ("", *(COLUMNS[key][0] for key in keys), "fault"), rows)


def _cell(value: float | None, style: str) -> str:
    return "–" if value is None else format(value, style)


def figures_of(out: Path, outcomes: Mapping[tuple[str, str], Outcome]) -> list[Figure]:
    """A picture for each drive, with a panel for each method."""
    drives = dict.fromkeys(drive for drive, _ in outcomes)
    text = "Grey: true path and true objects. Blue: path as it stands at the end, aligned, and objects near a true one;"
    text += f" red: objects farther than {GHOST_M:g} m from all. Where no pose is known, nothing is aligned."
    figures = []
    for drive in drives:
        own = {method: outcome for (name, method), outcome in outcomes.items() if name == drive and len(outcome.path)}
        if own:
            figures.append(Figure(drive, text, _picture(out / f"{drive.replace('/', '_')}.png", own)))
    return figures


def _picture(path: Path, outcomes: Mapping[str, Outcome]) -> Path:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    path.parent.mkdir(parents=True, exist_ok=True)
    columns = min(len(outcomes), COLUMNS_OF_PICTURE)
    rows = -(-len(outcomes) // columns)
    size = (4.2 * columns, 4.2 * rows)
    picture, axes = pyplot.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    for panel in axes.flat:
        panel.set_axis_off()
    for panel, (method, outcome) in zip(axes.flat, outcomes.items(), strict=False):
        panel.set_axis_on()
        _draw(panel, outcome)
        panel.set(title=method.replace("_", " "), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    picture.savefig(path, dpi=100)
    pyplot.close(picture)
    return path


def _draw(panel: Any, outcome: Outcome) -> None:
    panel.plot(*outcome.true_path.T, color="0.75", linewidth=3.0)
    panel.scatter(*outcome.true_objects.T, s=90, facecolors="none", edgecolors="0.45", linewidths=1.5)
    panel.plot(*outcome.path.T, color="tab:blue", linewidth=0.8)
    near = _near(outcome.objects, outcome.true_objects)
    panel.scatter(*outcome.objects[near].T, s=14, color="tab:blue", marker="x")
    panel.scatter(*outcome.objects[~near].T, s=18, color="tab:red", marker="x")


def _near(objects: Array, true_objects: Array) -> Any:
    """(O,) whether a true object lies near; everything counts as near where no true one is known."""
    if not len(true_objects):
        return np.ones(len(objects), dtype=bool)
    away = np.linalg.norm(objects[:, None] - true_objects[None], axis=-1)
    return away.min(axis=1, initial=np.inf) <= GHOST_M
