"""Charts of quantities over keyframes, with a common time axis."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from semantic_slam.evaluation.evaluate import Evaluation, class_rows
from semantic_slam.geometry.chi_squared import chi_squared_quantile
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.hypotheses import RECENT_KEYFRAMES
from semantic_slam.report.document import Analysis
from semantic_slam.report.drawing.plot import Plot
from semantic_slam.report.wording import known

SHOWN_COLUMNS = 10
"""Hypotheses drawn one by one in a column of weights; lighter ones share the rest."""
DISCARDED = "discarded_mass", "discarded_mass_window"
INK, GREYS = "#14212b", ("#9fabb5", "#c3ccd3")


@dataclass(frozen=True)
class Key:
    """One entry of a legend, with its value at every keyframe for the reader who points there."""

    kind: str  # CSS class of the swatch
    name: str
    values: list[float]


@dataclass(frozen=True)
class Chart:
    """One figure."""

    title: str
    text: str  # what to see in it
    keys: list[Key]
    svg: Markup


def time_charts(analysis: Analysis) -> list[Chart]:
    """The charts that every run has."""
    beliefs = analysis.record.beliefs
    charts = [
        weights_chart(beliefs, analysis.ancestors),
        _entropies(beliefs),
        _counts(beliefs),
        discarded_chart(beliefs),
    ]
    return charts


def truth_charts(evaluation: Evaluation, beliefs: tuple[HybridBelief, ...]) -> list[Chart]:
    """The charts of a run with ground truth; those without any value are left out."""
    charts = [
        _true_association(evaluation, beliefs),
        _position_errors(evaluation, beliefs),
        _consistency(evaluation, beliefs),
        _true_classes(evaluation, beliefs),
    ]
    return [chart for chart in charts if any(np.isfinite(key.values).any() for key in chart.keys)]


def keyframes(beliefs: tuple[HybridBelief, ...]) -> NDArray[np.int_]:
    return np.array([belief.keyframe for belief in beliefs])


def time_plot(beliefs: tuple[HybridBelief, ...], low: float, high: float, label: str, **options: Any) -> Plot:
    """An empty plot over all keyframes."""
    first, last = beliefs[0].keyframe, beliefs[-1].keyframe
    return Plot((first - 0.5, last + 0.5), (low, high), label=label, **options)


def weights_chart(beliefs: tuple[HybridBelief, ...], ancestors: list[int]) -> Chart:
    """Weights of all hypotheses; ``ancestors`` are the places of those that lead to the final answer, -1 unknown."""
    plot = time_plot(beliefs, 0.0, 1.0, "weights of the hypotheses, stacked, per keyframe")
    plot.axes(y_ticks=(0, 0.25, 0.5, 0.75, 1))
    final = []
    for belief, index in zip(beliefs, ancestors, strict=True):
        weights = np.exp(belief.log_weights)
        final.append(float(weights[index]) if index >= 0 else float("nan"))
        others = np.sort(np.delete(weights, index) if index >= 0 else weights)[::-1]
        stack = [*others[:SHOWN_COLUMNS], others[SHOWN_COLUMNS:].sum()]
        top = weights[index] if index >= 0 else 0.0
        plot.column(belief.keyframe, 0.0, top, INK)
        for rank, weight in enumerate(stack):
            if weight > 1e-3:
                plot.column(belief.keyframe, top, top + weight, GREYS[rank % 2])
            top += weight
    keys = [Key("ink", "leads to the final answer", final), Key("grey", "all others", [1 - value for value in final])]
    text = "One column per keyframe, one segment per hypothesis. Dark: the ancestor of the finally best one."
    return Chart("Hypothesis weights", text, keys, plot.svg())


def _entropies(beliefs: tuple[HybridBelief, ...]) -> Chart:
    association = [belief.association_entropy for belief in beliefs]
    component = [belief.component_entropy for belief in beliefs]
    high = float(np.nanmax([*association, *component, 0.5])) * 1.08
    plot = time_plot(beliefs, 0.0, high, "entropy over associations and over components")
    plot.axes()
    plot.line(keyframes(beliefs), component, "line second")
    plot.line(keyframes(beliefs), association, "line first")
    keys = [Key("first", "associations", association), Key("second", "components", component)]
    text = "In nats; 0 means one explanation, ln 2 = 0.69 two equal ones. Components also differ in classes and modes."
    return Chart("Entropy", text, keys, plot.svg())


def _counts(beliefs: tuple[HybridBelief, ...]) -> Chart:
    candidates = [float(belief.num_candidates) for belief in beliefs]
    kept = [float(len(belief.hypothesis_ids)) for belief in beliefs]
    plot = time_plot(
        beliefs, 0.8, max(10.0, *candidates, *kept) * 1.2, "candidates weighed and hypotheses kept", logarithmic=True
    )
    plot.axes()
    plot.line(keyframes(beliefs), candidates, "line second")
    plot.line(keyframes(beliefs), kept, "line first")
    keys = [Key("first", "hypotheses kept", kept), Key("second", "candidates weighed", candidates)]
    return Chart("Effort", "Logarithmic. Candidates are weighed first; the light ones are pruned.", keys, plot.svg())


def discarded_chart(beliefs: tuple[HybridBelief, ...]) -> Chart:
    """What was given up of the probability."""
    mass, lately = ([getattr(belief, name) for belief in beliefs] for name in DISCARDED)
    high = max(0.01, float(np.nanmax(mass)) * 1.15)
    plot = time_plot(beliefs, 0.0, min(high, 1.0), "discarded probability mass")
    plot.axes()
    plot.line(keyframes(beliefs), mass, "line second")
    plot.line(keyframes(beliefs), lately, "line first")
    text = (
        "Probability that was pruned or never enumerated, 1 − ∏(1 − d). Stated probabilities are no better than what"
        f" was discarded in the last {RECENT_KEYFRAMES} keyframes. What is found again later is taken off both."
    )
    keys = [Key("first", f"last {RECENT_KEYFRAMES} keyframes", lately), Key("second", "since the start", mass)]
    return Chart("Discarded mass", text, keys, plot.svg())


def _true_association(evaluation: Evaluation, beliefs: tuple[HybridBelief, ...]) -> Chart:
    judged = known(evaluation.metrics["association_right"])
    values = evaluation.true_association_probability if judged else np.full(len(beliefs), np.nan)
    plot = time_plot(beliefs, 0.0, 1.0, "probability of the true association history")
    plot.axes(y_ticks=(0, 0.25, 0.5, 0.75, 1))
    plot.line(keyframes(beliefs), values, "line first")
    settled = evaluation.metrics["keyframe_disambiguated"]
    if settled is not None:
        plot.mark(float(settled), f"≥ 0.99 from keyframe {settled} on")
    text = "Weight of all hypotheses that gave every detection so far its true object."
    return Chart("P(true association)", text, [Key("first", "P(true association)", list(values))], plot.svg())


def _position_errors(evaluation: Evaluation, beliefs: tuple[HybridBelief, ...]) -> Chart:
    axes = 2 if beliefs[-1].planar else 3
    courses = {
        "third": ("dead reckoning, from the prior mean", evaluation.dead_reckoning),
        "second": ("dead reckoning, from the true start", evaluation.dead_reckoning_true_start),
        "first": ("final path", evaluation.final_poses),
    }
    errors = {
        kind: np.linalg.norm((poses - evaluation.true_poses)[:, :axes], axis=1) for kind, (_, poses) in courses.items()
    }
    finite = np.concatenate([values[np.isfinite(values)] for values in errors.values()])
    low, high = (max(finite.min(), 3e-3), max(finite.max(), 1e-1)) if len(finite) else (0.01, 1.0)
    low = min(low, high / 10)
    plot = time_plot(beliefs, 10 ** np.floor(np.log10(low)), high * 1.3, "position errors", logarithmic=True)
    plot.axes()
    for kind in courses:
        plot.line(keyframes(beliefs), errors[kind], f"line {kind}")
    keys = [Key(kind, courses[kind][0], list(errors[kind])) for kind in reversed(courses)]
    text = "Metres from the true position, in map, unaligned; logarithmic. Final path: of the finally best hypothesis."
    return Chart("Position error", text, keys, plot.svg())


def _consistency(evaluation: Evaluation, beliefs: tuple[HybridBelief, ...]) -> Chart:
    degrees = 3 if beliefs[-1].planar else 6
    low, high = (float(value) for value in chi_squared_quantile([0.025, 0.975], degrees))
    finite = evaluation.nees[np.isfinite(evaluation.nees) & (evaluation.nees > 0)]
    top = max(high * 2, float(finite.max()) * 1.3 if len(finite) else 0.0)
    plot = time_plot(beliefs, min(0.05, low / 2), top, "NEES of the robot's pose", logarithmic=True)
    plot.area(plot.x_range, (low, low), (high, high), "#e4eef8")
    plot.axes()
    plot.rule(degrees, "mark", "expected")
    plot.line(keyframes(beliefs), evaluation.nees, "line first")
    text = (
        f"Squared error of the pose over its stated covariance; {degrees} on average when honest. Shaded: 95 % range."
    )
    return Chart("Consistency (NEES)", text, [Key("first", "NEES", list(evaluation.nees))], plot.svg())


def _true_classes(evaluation: Evaluation, beliefs: tuple[HybridBelief, ...]) -> Chart:
    means, least = [], []
    for belief in beliefs:
        rows, true = class_rows((belief,), evaluation.true_classes)
        values = rows[np.arange(len(true)), true]
        means.append(float(values.mean()) if len(values) else float("nan"))
        least.append(float(values.min()) if len(values) else float("nan"))
    plot = time_plot(beliefs, 0.0, 1.0, "probability of the objects' true classes")
    plot.axes(y_ticks=(0, 0.25, 0.5, 0.75, 1))
    plot.line(keyframes(beliefs), means, "line second")
    plot.line(keyframes(beliefs), least, "line first")
    keys = [Key("first", "least of all objects", least), Key("second", "mean", means)]
    return Chart("P(true class)", "What the map says of each object's true class, seen or not.", keys, plot.svg())
