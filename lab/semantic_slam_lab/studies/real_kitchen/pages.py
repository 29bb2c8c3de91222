"""Claims, table and picture of the kitchen."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from semantic_slam_lab.studies.real_kitchen.judged import Judged
from semantic_slam_lab.studies.real_kitchen.reference import COUNTS
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Figure, Table

LARGEST_ERROR_M = 0.10
MARKERS = {"chair": "s", "cup": "^"}


def claims_of(result: Mapping[str, Any]) -> list[Claim]:
    """What the map of the kitchen has to show, for each method."""
    return [claim for name, row in result["methods"].items() for claim in _claims(name.replace("_", " "), row)]


def _claims(name: str, row: Mapping[str, Any]) -> list[Claim]:
    counts, errors = row["counts"], row["position_error_m"]
    found = [error for error in errors.values() if error is not None]
    measured = ", ".join("missing" if error is None else f"{error:.2f}" for error in errors.values())
    all_near = len(found) == sum(COUNTS.values()) and max(found) <= LARGEST_ERROR_M
    told = f"{counts['chair']} chairs, {counts['cup']} mugs"
    ate, odometry = row["ate_aligned_m"], row["odometry_ate_aligned_m"]
    return [
        Claim(f"Three chairs and two mugs ({name})", REQUIREMENT, "", told, counts == COUNTS),
        Claim(f"No ghost among them ({name})", REQUIREMENT, "", str(row["ghosts"]), row["ghosts"] == 0),
        Claim(f"Each within {LARGEST_ERROR_M:.2f} m ({name})", REQUIREMENT, "", f"{measured} m", all_near),
        Claim(
            f"Path no worse than its odometry ({name})",
            REQUIREMENT,
            "",
            f"{ate:.3f}, {odometry:.3f} m",
            ate <= odometry,
        ),
    ]


def tables_of(runs: Mapping[str, Judged]) -> list[Table]:
    """Every number of each method."""
    keys = [key for key, value in runs["ours"].metrics.items() if not isinstance(value, dict)]
    rows = tuple((name, *(_cell(run.metrics[key]) for key in keys)) for name, run in runs.items())
    places = tuple(
        (name, *(_cell(error) for error in run.metrics["position_error_m"].values())) for name, run in runs.items()
    )
    names = tuple(runs["ours"].metrics["position_error_m"])
    return [Table("Methods", ("", *keys), rows), Table("Errors of places [m]", ("", *names), places)]


def _cell(value: float | int | None) -> str:
    return "–" if value is None else str(value) if isinstance(value, int) else f"{value:.3f}"


def figures_of(out: Path, runs: Mapping[str, Judged]) -> list[Figure]:
    """The map of each method beside what is there."""
    text = "Grey: true path, chairs (squares) and mugs (triangles) where their boxes are under the given poses."
    text += " Blue: path as it stands at the end, aligned; red: chairs and mugs with existence above one half."
    return [Figure("The kitchen from above", text, _picture(out / "map.png", runs))]


def _picture(path: Path, runs: Mapping[str, Judged]) -> Path:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    path.parent.mkdir(parents=True, exist_ok=True)
    picture, axes = pyplot.subplots(1, len(runs), figsize=(5.0 * len(runs), 4.5), layout="constrained", squeeze=False)
    for panel, (name, run) in zip(axes.flat, runs.items(), strict=True):
        panel.plot(*run.true_path.T, color="0.75", linewidth=3.0)
        panel.plot(*run.path.T, color="tab:blue", linewidth=0.8)
        for marker in COUNTS:
            there = [row for row, own in enumerate(run.there.classes) if own == marker]
            stated = [row for row, own in enumerate(run.classes) if own == marker]
            style = {"marker": MARKERS[marker], "facecolors": "none"}
            panel.scatter(*run.there.positions[there].T, s=120, edgecolors="0.45", **style)
            panel.scatter(*run.stated[stated].T, s=50, edgecolors="tab:red", **style)
        panel.set(title=name.replace("_", " "), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    picture.savefig(path, dpi=100)
    pyplot.close(picture)
    return path
