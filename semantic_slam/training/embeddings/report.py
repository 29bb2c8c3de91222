"""What was learned of a network's vectors, in numbers and in words."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from semantic_slam.training.embeddings.looks import RunLooks
from semantic_slam.training.judgement import Judgement
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel
from semantic_slam.viewpoint.embeddings.store import LooksByDirection


def report_of(
    before: EmbeddingModel, runs: Sequence[RunLooks], whole: LooksByDirection | None, first: Judgement, last: Judgement
) -> dict[str, Any]:
    """Numbers of the parameters that were found and of their held-out judgement; ``whole`` None: they are not kept."""
    model = before if whole is None else whole.of(before)
    usual = np.exp(model.usual(np.zeros(len(model.within))))
    return {
        "is_kept": whole is not None,
        "views": sum(own.num_views for own in runs),
        "runs": len(runs),
        "held_out": {"before": _numbers(first), "after": _numbers(last)},
        "repeat_rad": model.repeat_rad,
        "outlier_share": model.outlier_share,
        "spread_share": float(usual @ model.settings[0]),
        "noise_share": float(usual @ model.settings[1]),
    }


def _numbers(own: Judgement) -> dict[str, float]:
    return {
        "log_evidence": own.log_evidence,
        "calibration_error": own.calibration_error,
        "num_pairs": len(own.answers),
    }


def lines_of(own: Mapping[str, Any]) -> list[str]:
    """The report in a few lines."""
    before, after = own["held_out"]["before"], own["held_out"]["after"]
    judged = (
        f"held-out log evidence {before['log_evidence']:.1f} -> {after['log_evidence']:.1f} nats of {own['views']}"
        f" vectors of {own['runs']} run{'' if own['runs'] == 1 else 's'}"
    )
    if after["num_pairs"]:
        judged += (
            f", the calibration error of {after['num_pairs']} pairs of them {before['calibration_error']:.3f} ->"
            f" {after['calibration_error']:.3f}"
        )
    if not own["is_kept"]:
        return [f"vectors: too little to learn from, so their models are as before any fit: {judged}"]
    return [
        f"vectors: an object's looks change over {own['repeat_rad']:g} rad of direction; of the spread of all vectors"
        f" the sides of one object have {own['spread_share']:.0%} and its views from one place"
        f" {own['noise_share']:.0%}; outliers {own['outlier_share']:g}",
        judged,
    ]
