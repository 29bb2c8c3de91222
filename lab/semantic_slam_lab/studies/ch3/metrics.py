"""Numbers and percentile fans of chapter 3 from the log posteriors of many realisations."""

from collections.abc import Mapping, Sequence

import numpy as np

from semantic_slam.classification.metrics import correct, log_mgr, msde
from semantic_slam.evaluation.classification import expected_calibration_error
from semantic_slam.geometry.arrays import Array

PERCENTILES = (10, 20, 30, 40, 50, 60, 70, 80, 90)
TRUE = 0
"""Column of the true class, whichever it was in a realisation."""

LogPosteriors = Mapping[str, Array]
"""Method -> (K, C) or (N, K, C) log posteriors, the true class first."""


def true_class_first(log_posteriors: Array, true_class: int) -> Array:
    """(..., C) with the true class's column moved to the front."""
    others = [c for c in range(log_posteriors.shape[-1]) if c != true_class]
    return np.asarray(log_posteriors[..., [true_class, *others]])


def stacked(realisations: Sequence[LogPosteriors]) -> dict[str, Array]:
    """Method -> (N, K, C)."""
    return {name: np.stack([each[name] for each in realisations]) for name in realisations[0]}


def summary(log_posteriors: Array) -> dict[str, float]:
    """Metrics of (N, K, C) log posteriors; "overall" and calibration are over all steps of all realisations."""
    right, ratio = correct(log_posteriors, TRUE), log_mgr(log_posteriors, TRUE)
    errors = msde(log_posteriors, TRUE)
    flat = np.exp(log_posteriors).reshape(-1, log_posteriors.shape[-1])
    return {
        "correct_rate_final": float(right[:, -1].mean()),
        "correct_rate_overall": float(right.mean()),
        "log_mgr_final_p75": float(np.percentile(ratio[:, -1], 75)),
        "log_mgr_final_p95": float(np.percentile(ratio[:, -1], 95)),
        "log_mgr_overall_p75": float(np.percentile(ratio, 75)),
        "log_mgr_overall_p95": float(np.percentile(ratio, 95)),
        "msde_final": float(errors[:, -1].mean()),
        "nll": float(-log_posteriors[..., TRUE].mean()),
        "ece": expected_calibration_error(flat, np.full(len(flat), TRUE)),
        "brier": float(errors.mean() * log_posteriors.shape[-1]),
    }


def fans(log_posteriors: Array) -> dict[str, list[list[float]]]:
    """Metric -> K steps x percentiles over the N realisations, as Fig. 3.3 shows them."""
    values = {
        "p_true": np.exp(log_posteriors[..., TRUE]),
        "log_mgr": log_mgr(log_posteriors, TRUE),
        "msde": msde(log_posteriors, TRUE),
    }
    return {name: np.percentile(value, PERCENTILES, axis=0).T.tolist() for name, value in values.items()}


def correct_rates(log_posteriors: Array) -> list[float]:
    """(K,) share of right classifications at each step."""
    return [float(rate) for rate in correct(log_posteriors, TRUE).mean(axis=0)]
