"""Claims, tables and the map of the Victoria Park study, from its result."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.studies.result import Claim, Figure, Table
from semantic_slam.studies.victoria_park_methods import Outcome

Array = NDArray[np.float64]

REQUIREMENT = "project requirement"
PASSED_F1 = 0.99
WORDS = {"ours": "open world", "joint_assignment": "joint assignment", "nearest_neighbour": "nearest neighbour"}
COLUMNS = {
    "association_f1": "F1",
    "association_f1_merged": "F1, doubtful pairs as one",
    "n_landmarks": "landmarks",
    "rms_to_known_association_m": "RMS to known association [m]",
    "ms_per_keyframe_p50": "ms p50",
    "ms_per_keyframe_p95": "p95",
    "ms_per_keyframe_max": "max",
    "real_time_factor": "x real time",
    "hypotheses_mean": "hypotheses kept",
    "peak_rss_mb": "MB",
}


def claims_of(result: dict[str, Any]) -> list[Claim]:
    """What issue and data set ask for."""
    ours = result["methods"]["ours"]
    runs = [row for name, row in result["dropped_10"].items() if name.endswith("/ours")]
    passed = sum(passes(row) for row in runs)
    factors = result["odometry_factors"]
    good = [name for name, row in factors.items() if passes(row)]
    return [
        _claim(
            "Association F1 >= 0.975, and >= 0.995 with the doubtful pairs as one",
            f"{ours['association_f1']:.4f} and {ours['association_f1_merged']:.4f}",
            ours["association_f1"] >= 0.975 and ours["association_f1_merged"] >= 0.995,
        ),
        _claim(
            "140 to 160 landmarks (whole drive)",
            f"{ours['n_landmarks']:.0f} after {result['num_keyframes']} keyframes",
            140 <= ours["n_landmarks"] <= 160,
        ),
        _claim(
            "RMS distance to the known-association solution <= 1.0 m",
            f"{ours['rms_to_known_association_m']:.2f} m",
            ours["rms_to_known_association_m"] <= 1.0,
        ),
        _claim(
            "At least 50 times real time, no keyframe over 222 ms",
            f"{ours['real_time_factor']:.0f} times, {ours['ms_per_keyframe_max']:.0f} ms",
            ours["real_time_factor"] >= 50.0 and ours["ms_per_keyframe_max"] <= 222.0,
        ),
        _claim(
            "19 of 20 reruns with 10 % of the detections dropped reach 0.99",
            f"{passed} of {len(runs)}",
            passed >= 0.95 * len(runs),
        ),
        _claim(
            "So does the file's odometry covariance times 4 to 50",
            f"{', '.join(good) or 'none'} of {', '.join(factors)}",
            len(good) == len(factors),
        ),
    ]


def passes(row: dict[str, Any]) -> bool:
    """A rerun that counts as right."""
    return bool(row["association_f1_merged"] > PASSED_F1 and not row["fault"])


def _claim(text: str, measured: str, holds: bool) -> Claim:
    return Claim(text, REQUIREMENT, "", measured, bool(holds))


def tables_of(result: dict[str, Any]) -> list[Table]:
    """The methods, the hard variants, the reruns, the noise."""
    tables = [_table("The whole file", result["methods"])]
    for name, title in (("dropped_40", "40 % of the detections dropped"), ("blind_100m", "100 m of every 300 m blind")):
        tables.append(_table(title, result[name]))
    tables.append(_table("10 % dropped", result["dropped_10"]))
    tables.append(_table("The file's odometry covariance times", result["odometry_factors"]))
    evidence = tuple((name, f"{value:.0f}") for name, value in result["noise"]["log_evidence"].items())
    return [*tables, Table("Noise by evidence", ("odometry covariance, detections", "log evidence"), evidence)]


def _table(title: str, rows: dict[str, dict[str, Any]]) -> Table:
    columns = {key: words for key, words in COLUMNS.items() if any(key in row for row in rows.values())}
    cells = tuple((WORDS.get(name, name), *(_number(row.get(key)) for key in columns)) for name, row in rows.items())
    return Table(title, ("", *columns.values()), cells)


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.4f}" if value <= 1.0 else f"{value:.3g}" if value < 100 else f"{value:.0f}"


def figure_of(out: Path, outcomes: dict[str, Outcome], reference: Array) -> Figure:
    """Paths of the methods over that with known association."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    out.mkdir(parents=True, exist_ok=True)
    picture, axes = pyplot.subplots(figsize=(7.0, 6.0), layout="constrained")
    axes.plot(*reference[:, :2].T, color="0.6", linewidth=3.0, label="known association")
    for name, words in WORDS.items():
        axes.plot(*outcomes[name].poses[:, :2].T, linewidth=0.8, label=words)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend()
    file = out / "paths.png"
    picture.savefig(file, dpi=110)
    pyplot.close(picture)
    return Figure("Paths", "The open world's path lies on that of the known association.", file)
