"""Report charts of the newest keyframes of a running run."""

import threading
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from semantic_slam.evaluation.history import lineage
from semantic_slam.geometry.optional_arrays import left_out
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.object_table import columns
from semantic_slam.report.drawing.charts import Chart, discarded_chart, weights_chart
from semantic_slam.report.drawing.explanation_charts import unexplained_chart
from semantic_slam.report.rendering import environment

CHARTED = 240
"""Keyframes."""
EMPTIED = (
    *("object_ids", "detection_ids", "modes", "poses", "pose_covariances", "noise_values", "noise_sigmas"),
    *("revised_ids", "revised_keyframes", "revised_detections", "revised_objects"),
    *("place_objects", "place_probabilities", "place_means", "place_covariances"),
)
"""Arrays of a belief that the charts do not show."""


class LiveCharts:
    """Weights, what is unexplained and what was discarded; drawn when somebody looks, and once for all who do."""

    def __init__(self) -> None:
        self._beliefs: deque[HybridBelief] = deque(maxlen=CHARTED)
        self._drawn: tuple[int, dict[str, Any]] = (-1, {"keyframes": [], "html": ""})
        self._drawing = threading.Lock()

    def add(self, belief: HybridBelief) -> None:
        self._beliefs.append(without_objects(belief))

    @property
    def beliefs(self) -> tuple[HybridBelief, ...]:
        """What there is to be drawn."""
        return tuple(self._beliefs)

    def draw(self, beliefs: tuple[HybridBelief, ...]) -> dict[str, Any]:
        """Their keyframes and their HTML, in which every text is escaped."""
        with self._drawing:
            if beliefs and beliefs[-1].keyframe != self._drawn[0]:
                self._drawn = beliefs[-1].keyframe, _drawn(beliefs)
            return self._drawn[1]


def _drawn(beliefs: tuple[HybridBelief, ...]) -> dict[str, Any]:
    charts = [_weights(beliefs), discarded_chart(beliefs)]
    if np.isfinite([belief.unexplained for belief in beliefs]).any():
        charts.insert(1, unexplained_chart(beliefs))
    draw = environment().get_template("parts.html").module.chart  # type: ignore[attr-defined]  # a macro
    return {"keyframes": [belief.keyframe for belief in beliefs], "html": "".join(map(draw, charts))}


def _weights(beliefs: tuple[HybridBelief, ...]) -> Chart:
    """The report's chart, of a run that has no final answer yet."""
    chart = weights_chart(beliefs, lineage(beliefs))
    keys = [replace(chart.keys[0], name="leads to the best one now"), *chart.keys[1:]]
    return replace(chart, keys=keys, text="One column per keyframe, one segment per hypothesis.")


def without_objects(belief: HybridBelief) -> HybridBelief:
    """The belief's weights and lineage alone, in memory of their own: a message's arrays are views of all its bytes."""
    per_object: dict[str, Any] = {name: np.zeros((0, *values.shape[1:])) for name, values in columns(belief).items()}
    nothing: dict[str, Any] = {
        "class_names": (),
        "object_names": (),
        "noise_names": (),
        "associations": np.zeros((len(belief.hypothesis_ids), 0), dtype=np.int32),
        "hypothesis_class_probabilities": np.zeros((0, 0, 0)),
        "association_probabilities": left_out(),
        "outlier_probability": left_out(),
        **{name: getattr(belief, name)[:0].copy() for name in EMPTIED},
    }
    own: dict[str, Any] = {
        name: getattr(belief, name).copy() for name in ("hypothesis_ids", "parent_ids", "log_weights")
    }
    return replace(belief, **per_object, **nothing, **own)
