"""Claims, tables and the map of the Victoria Park study, from its result."""

from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.result import Claim, Figure, Table, required
from semantic_slam_lab.studies.victoria_park.methods import Outcome

PASSED_F1 = 0.99
REFERENCE = (
    "Where a path lies on the broad grey one, association was right. Known association is the minimum of half the"
    " squared whitened residuals of odometry (its biases being variables), detections and start under the same noise,"
    " and nothing is aligned: both hang on the same start. The costs in the tables are that minimum under a method's"
    " own associations."
)
FRAME_S = 0.222
"""Time from one frame of the drive to the next [s]."""
STYLES = {"nearest_neighbour": "C1:", "joint_assignment": "C2--", "ours": "C0-"}
WORDS = {"ours": "open world", "joint_assignment": "joint assignment", "nearest_neighbour": "nearest neighbour"}
COLUMNS = {
    "association_f1": "F1",
    "association_f1_merged": "F1, doubtful pairs as one",
    "n_landmarks": "landmarks",
    "rms_to_known_association_m": "RMS to known association [m]",
    "cost_under_own_associations": "cost",
    "ms_per_keyframe_p50": "ms p50",
    "ms_per_keyframe_p95": "p95",
    "ms_per_keyframe_max": "max",
    "real_time_factor": "x real time",
    "hypotheses_mean": "hypotheses kept",
    "noise_factor": "odometry covariance x",
    "heading_bias_rad_per_m": "heading bias [rad/m]",
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
        required(
            "Association F1 >= 0.975, and >= 0.995 with the doubtful pairs as one",
            f"{ours['association_f1']:.4f} and {ours['association_f1_merged']:.4f}",
            ours["association_f1"] >= 0.975 and ours["association_f1_merged"] >= 0.995,
        ),
        required(
            "140 to 160 landmarks (whole drive)",
            f"{ours['n_landmarks']:.0f} after {result['num_keyframes']} keyframes",
            140 <= ours["n_landmarks"] <= 160,
        ),
        required(
            "RMS distance to the known-association solution <= 1.0 m",
            f"{ours['rms_to_known_association_m']:.2f} m",
            ours["rms_to_known_association_m"] <= 1.0,
        ),
        required(
            "At least 50 times real time, no keyframe over 222 ms (CPU time of the one thread)",
            f"{ours['real_time_factor']:.0f} times, {ours['ms_per_keyframe_max']:.0f} ms",
            ours["real_time_factor"] >= 50.0 and ours["ms_per_keyframe_max"] <= 222.0,
        ),
        required(
            "19 of 20 reruns with 10 % of the detections dropped reach 0.99",
            f"{passed} of {len(runs)}",
            passed >= 0.95 * len(runs),
        ),
        required(
            "So does the file's odometry covariance times 4 to 50",
            f"{', '.join(good) or 'none'} of {', '.join(factors)}",
            len(good) == len(factors),
        ),
    ]


def passes(row: dict[str, Any]) -> bool:
    """A rerun that counts as right."""
    return bool(row["association_f1_merged"] > PASSED_F1 and not row["fault"])


def tables_of(result: dict[str, Any]) -> list[Table]:
    """The methods, the hard variants, the reruns, the noise."""
    noise = f"odometry x{result['noise']['odometry_factor']:g}, trunks {result['noise']['landmark_variance_m2']:g} m^2"
    known = {
        "known association": {
            "cost_under_own_associations": result["known_association_cost"],
            "real_time_factor": result["known_association_real_time_factor"],
            "fault": "",
        },
        "known, doubtful pairs as one": {"cost_under_own_associations": result["merged_association_cost"], "fault": ""},
    }
    title = f"The whole drive, {result['num_keyframes']} keyframes, {noise}"
    tables = [_table(title, result["methods"] | known)]
    for name, title in (("dropped_40", "40 % of the detections dropped"), ("blind_100m", "100 m of every 300 m blind")):
        tables.append(_table(title, result[name]))
    tables.append(_reruns("10 % of the detections dropped, at random", result["dropped_10"]))
    tables.append(_table("Odometry covariance given: the file's times ...", result["odometry_factors"]))
    return tables


def _table(title: str, rows: dict[str, dict[str, Any]]) -> Table:
    columns = {key: words for key, words in COLUMNS.items() if any(key in row for row in rows.values())}
    cells = tuple(
        (WORDS.get(name, name), *(_number(key, row.get(key)) for key in columns), _fault(row))
        for name, row in rows.items()
    )
    return Table(title, ("", *columns.values(), "ended"), cells)


def _fault(row: dict[str, Any]) -> str:
    return "early" if row["fault"] else "whole"


def _reruns(title: str, rows: dict[str, dict[str, Any]]) -> Table:
    """One line per method: the runs that count as right, the F1 between which they lie, the landmarks."""
    cells = []
    for method, words in WORDS.items():
        own = [row for name, row in rows.items() if name.endswith(f"/{method}")]
        if own:
            merged = np.array([row["association_f1_merged"] for row in own])
            landmarks = np.array([row["n_landmarks"] for row in own])
            passed = f"{sum(passes(row) for row in own)} of {len(own)}"
            between = f"{merged.min():.4f}, {np.median(merged):.4f}, {merged.max():.4f}"
            cells.append((words, passed, between, f"{landmarks.min():.0f} to {landmarks.max():.0f}"))
    columns = ("", f"F1, doubtful pairs as one, above {PASSED_F1:g}", "that F1: least, median, largest", "landmarks")
    return Table(title, columns, tuple(cells))


def _number(key: str, value: float | None) -> str:
    if value is None:
        return ""
    if key.startswith("association_f1"):
        return f"{value:.4f}"
    return f"{value:.3g}" if value < 100 else f"{value:.0f}"


def figures_of(out: Path, outcomes: dict[str, Outcome], reference: Array) -> list[Figure]:
    """Paths of the methods over that with known association; time and hypotheses over the drive."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    out.mkdir(parents=True, exist_ok=True)
    picture, axes = pyplot.subplots(figsize=(7.0, 6.0), layout="constrained")
    axes.plot(*reference[:, :2].T, color="0.75", linewidth=5.0, label="known association")
    for name, style in STYLES.items():
        axes.plot(*outcomes[name].poses[:, :2].T, style, linewidth=0.9, label=WORDS[name])
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.legend()
    paths = out / "paths.png"
    picture.savefig(paths, dpi=110)
    pyplot.close(picture)
    picture, panels = pyplot.subplots(2, 1, figsize=(7.0, 4.0), layout="constrained", sharex=True)
    ours = outcomes["ours"]
    panels[0].plot(ours.milliseconds, linewidth=0.5)
    panels[0].axhline(1e3 * FRAME_S, color="0.5", linestyle="--", linewidth=0.8)
    panels[0].set(ylabel="ms", yscale="log")
    panels[1].plot(ours.hypotheses, linewidth=0.7)
    panels[1].set(ylabel="hypotheses kept", xlabel="keyframe")
    times = out / "times.png"
    picture.savefig(times, dpi=110)
    pyplot.close(picture)
    return [
        Figure("Paths", REFERENCE, paths),
        Figure("Time and hypotheses", "Per keyframe of the open world; dashed: one frame of the drive.", times),
    ]
