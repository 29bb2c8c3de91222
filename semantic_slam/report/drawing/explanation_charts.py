"""Charts of model fit per keyframe: evidence, innovations, and unexplained data."""

import numpy as np

from semantic_slam.evaluation.record import Record
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.chi_squared import chi_squared_quantile
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.evidence.model_fit import UNEXPLAINED
from semantic_slam.report.drawing.charts import Chart, Key, keyframes, time_plot

LOW_NIS, LOWEST_NIS = 1e-2, 1e-4
"""Greatest and least lower limit of the axis of normalised innovations; smaller values are marked at its end."""


def explanation_charts(record: Record) -> list[Chart]:
    """Charts of what the beliefs say of their data; those without any value are left out."""
    charts = [_evidence(record.beliefs), _innovations(record), unexplained_chart(record.beliefs)]
    return [chart for chart in charts if np.isfinite(chart.keys[0].values).any()]


def _evidence(beliefs: tuple[HybridBelief, ...]) -> Chart:
    values = [belief.log_evidence / max(len(belief.detection_ids), 1) for belief in beliefs]
    finite = [value for value in values if np.isfinite(value)] or [0.0]
    low, high = min(*finite, 0.0), max(*finite, 1.0)
    plot = time_plot(beliefs, low - 0.05 * (high - low), high + 0.05 * (high - low), "log evidence per detection")
    plot.axes()
    plot.line(keyframes(beliefs), values, "line first")
    text = (
        "Nats per detection: log density of the keyframe as the belief before expected it. A fall says that it did not."
    )
    return Chart("Log evidence", text, [Key("first", "log evidence per detection", values)], plot.svg())


def _innovations(record: Record) -> Chart:
    beliefs = record.beliefs
    values = np.array([belief.innovation_nees for belief in beliefs])
    low, high = innovation_band(record)
    finite = np.concatenate([values, high, [2.0]])
    top = 1.3 * float(np.nanmax(finite[np.isfinite(finite)]))
    least = float(values[values > 0.0].min(initial=LOW_NIS))
    bottom = max(10.0 ** np.floor(np.log10(least)), LOWEST_NIS)
    plot = time_plot(beliefs, bottom, top, "normalised innovation squared per degree of freedom", logarithmic=True)
    for place in np.flatnonzero(np.isfinite(high)).tolist():
        plot.column(beliefs[place].keyframe, low[place], high[place], "#e4eef8")
    plot.axes()
    plot.rule(1.0, "mark", "expected")
    plot.line(keyframes(beliefs), values, "line first")
    text = (
        "Squared difference between detections of known objects and their prediction, over its covariance, per number"
        " measured; 1 on average when honest. Shaded: 95 % range."
    )
    return Chart("Innovations (NIS)", text, [Key("first", "NIS", values.tolist())], plot.svg())


def innovation_band(record: Record) -> tuple[Array, Array]:
    """(K,) limits of the 95 % range of ``innovation_nees``, NaN where no detection is of a known object."""
    degrees = np.array([_degrees(record, belief) for belief in record.beliefs])
    degrees = np.where(degrees >= 0.5, degrees, np.nan)
    low, high = (chi_squared_quantile(share, degrees) / degrees for share in (0.025, 0.975))
    return low, high


def _degrees(record: Record, belief: HybridBelief) -> float:
    """Expected number of ranges and bearings that are of known objects."""
    measured = record.measurements.get(belief.stamp_ns)
    sizes = np.full(len(belief.detection_ids), 2.0)
    if measured is not None and len(measured) == len(sizes):
        sizes -= np.isnan(measured.ranges_m)
    return float(sizes @ np.nan_to_num(belief.association_probabilities[:, :-1].sum(axis=1)))


def unexplained_chart(beliefs: tuple[HybridBelief, ...]) -> Chart:
    """Whether the belief explains its data."""
    values = [belief.unexplained for belief in beliefs]
    plot = time_plot(beliefs, 0.0, 1.0, "probability that the belief does not explain its data")
    plot.axes(y_ticks=(0, 0.25, 0.5, 0.75, 1))
    plot.rule(UNEXPLAINED, "mark", "cannot explain its data")
    plot.line(keyframes(beliefs), values, "line first")
    text = (
        "Posterior that detections lie anywhere rather than where the belief has them, over the last keyframes;"
        " prior 0.001 per window."
    )
    return Chart("Unexplained", text, [Key("first", "unexplained", values)], plot.svg())
