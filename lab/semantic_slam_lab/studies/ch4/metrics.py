"""Metrics of many runs: averages over tracks and keyframes, and how they spread at each keyframe (Fig. 4.5)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.ch4.runs import Followed

PERCENTILES = (10, 25, 50, 75, 90)
METRICS = (
    "association_entropy",
    "component_entropy",
    "det_position_covariance",
    "error_max_weight_m",
    "error_weighted_m",
    "num_hypotheses",
    "discarded_mass",
    "p_true_association",
    "confidence",
    "likeliest_is_true",
)
Row = Mapping[str, Array]
"""Metric -> (K,) values of one run, NaN from where it was lost on; no probability is left to the truth from there."""


def row_of(followed: Followed, num_keyframes: int) -> dict[str, Array]:
    """The metrics of one run by keyframe, and its ``seconds`` in the engine."""
    row: dict[str, Array] = {}
    for metric in (*METRICS, "seconds"):
        values = np.full(num_keyframes, 0.0 if metric == "p_true_association" else np.nan)
        values[: len(followed.moments)] = [getattr(moment, metric) for moment in followed.moments]
        row[metric] = values
    row["lost"] = np.array([float(bool(followed.fault))])
    return row


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Averages over (N) runs and all their keyframes, ``final`` at the last one, ``steps`` at each.

    Keyframes after a run was lost are left out of every metric but ``p_true_association``, where they count as 0.
    """
    stacked = {metric: np.array([row[metric] for row in rows]) for metric in METRICS}
    final = {metric: _mean(values[:, -1]) for metric, values in stacked.items()}
    overall = {metric: _mean(values) for metric, values in stacked.items()}
    return {
        **overall,
        "p_true_association_final": final["p_true_association"],
        "p_true_association_least": float(stacked["p_true_association"][:, -1].min()),
        "discarded_mass_final": final["discarded_mass"],
        "runs": len(rows),
        "runs_lost": int(sum(row["lost"][0] for row in rows)),
        "truth_lost": int((stacked["p_true_association"][:, -1] == 0.0).sum()),
        "seconds_per_keyframe": _mean(np.array([row["seconds"] for row in rows])),
        "final": final,
        "steps": {metric: _steps(values) for metric, values in stacked.items()},
    }


def _steps(values: Array) -> dict[str, Any]:
    """Mean and percentiles of (N, K) values at each keyframe."""
    columns = [column[np.isfinite(column)] for column in values.T]
    return {
        "mean": [_mean(column) for column in columns],
        "percentiles": [np.percentile(column, PERCENTILES).tolist() if len(column) else None for column in columns],
    }


def _mean(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else None
