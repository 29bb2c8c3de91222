"""Pictures of chapter 4: worlds, posteriors over poses, probabilities of associations, metrics over the keyframes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Ellipse

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.report.drawing.ellipse import ellipses
from semantic_slam_lab.studies.ch4.runs import History, Moment
from semantic_slam_lab.studies.ch4.scenarios import Scenario
from semantic_slam_lab.studies.ch4.simulation import Run

WITH, WITHOUT, TRUTH, OBJECT = "#1f5fae", "#c0392b", "#2c8a3d", "#333333"
CURVES = {
    "association_entropy": "H over associations [nats]",
    "component_entropy": "H over components [nats]",
    "p_true_association": "P(true association)",
    "det_position_covariance": "det of position covariance [m⁴]",
    "error_max_weight_m": "error of the heaviest component [m]",
    "error_weighted_m": "error, weighted over components [m]",
}
LOGARITHMIC = ("det_position_covariance",)
VARIANTS = {"samples": ":", "Laplace": "-."}
"""Words in a method's name -> line style."""
MOST_BARS = 10
"""Association histories with a bar of their own."""


def curves_figure(file: Path, steps: Mapping[str, Mapping[str, Any]], banded: Sequence[str]) -> Path:
    """PNG with a panel per metric: method -> metric -> mean and percentiles over the runs at each keyframe."""
    canvas = Canvas(figsize=(13, 7.4), layout="constrained")
    colours = _method_colours(list(steps))
    for axis, (metric, label) in zip(canvas.subplots(2, 3, sharex=True).flat, CURVES.items(), strict=True):
        for name, curves in steps.items():
            mean = _array(curves[metric]["mean"])
            keyframes = np.arange(1, len(mean) + 1)
            style = next((mark for word, mark in VARIANTS.items() if word in name), "-")
            axis.plot(keyframes, mean, style, color=colours[name], linewidth=1.8, label=name)
            if name in banded:
                quartiles = np.array([row or [np.nan] * 5 for row in curves[metric]["percentiles"]], dtype=float)
                band = quartiles[:, [1, 3]].T
                axis.fill_between(keyframes, *band, color=colours[name], alpha=0.14, linewidth=0)
        axis.set(ylabel=label, yscale="log" if metric in LOGARITHMIC else "linear")
        _bare(axis)
    for axis in canvas.axes[-3:]:
        axis.set_xlabel("keyframe k")
    handles, names = canvas.axes[0].get_legend_handles_labels()
    canvas.legend(handles, names, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    canvas.savefig(file, dpi=110)
    return file


def tracks_figure(file: Path, scenario: Scenario, runs: Sequence[Run]) -> Path:
    """PNG of objects and true tracks of runs in one world."""
    canvas = Canvas(figsize=(9, 4.2), layout="constrained")
    axis = canvas.subplots()
    cycle = colormaps["turbo"](np.linspace(0.05, 0.95, len(runs)))
    for colour, run in zip(cycle, runs, strict=True):
        track = np.vstack([run.start, run.poses])
        axis.plot(track[:, 0], track[:, 1], color=colour, linewidth=0.9)
    draw_world(axis, scenario)
    axis.plot(*scenario.start[:2], "o", color=TRUTH, markersize=6, label="true start")
    axis.plot(*scenario.start_mean[:2], "x", color=WITHOUT, markersize=9, label="start as believed, ± 10 m")
    axis.legend(fontsize=8, frameon=False)
    canvas.savefig(file, dpi=110)
    return file


def draw_world(axis: Axes, scenario: Scenario) -> None:
    """Objects with headings and numbers, in metres of map."""
    x, y, heading = scenario.objects.T
    axis.plot(x, y, "o", color=OBJECT, markersize=5)
    axis.quiver(x, y, np.cos(heading), np.sin(heading), color=OBJECT, **_quiver(1.4))
    for n, (left, top, towards) in enumerate(scenario.objects):
        behind = (-11.0 * np.cos(towards), -11.0 * np.sin(towards))
        text, place = f"O{n + 1}", (left, top)
        axis.annotate(text, place, behind, textcoords="offset points", fontsize=8, ha="center", va="center")
    axis.update_datalim(np.stack([x + 1.6 * np.cos(heading), y + 1.6 * np.sin(heading)], axis=-1))
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    _bare(axis)


def posterior_figure(file: Path, run: Run, moments: Mapping[str, Sequence[Moment]], keyframes: Sequence[int]) -> Path:
    """PNG with a row per method and a column per k (1 is the first): components' ellipses, bolder for more weight."""
    canvas = Canvas(figsize=(4.2 * len(keyframes), 2.45 * len(moments)), layout="constrained")
    grid = canvas.subplots(len(moments), len(keyframes), sharex=True, sharey=True, squeeze=False)
    bounds = _bounds(run, moments)
    for line, (name, of_run) in zip(grid, moments.items(), strict=True):
        colour = WITHOUT if "without" in name else WITH
        for axis, k in zip(line, keyframes, strict=True):
            draw_world(axis, run.scenario)
            track = np.vstack([run.start, run.poses[:k]])
            axis.plot(*track[:, :2].T, color=TRUTH, linewidth=1.0, marker=".", markersize=3, label="true track")
            _robot(axis, run.poses[k - 1], TRUTH)
            if k <= len(of_run):
                _components(axis, of_run[k - 1], colour)
            axis.set(title=f"k = {k}, {name}", xlim=bounds[0], ylim=bounds[1])
            axis.label_outer()
    grid[0, 0].legend(fontsize=8, frameon=False, loc="upper left")
    canvas.savefig(file, dpi=100)
    return file


def association_figure(file: Path, run: Run, moments: Mapping[str, Sequence[Moment]], keyframes: Sequence[int]) -> Path:
    """PNG with a panel per k: probability of every association history that a method kept, the true one circled."""
    canvas = Canvas(figsize=(4.2 * len(keyframes), 3.2), layout="constrained")
    width, most = 0.8 / len(moments), 0
    for axis, k in zip(canvas.subplots(1, len(keyframes), sharey=True, squeeze=False)[0], keyframes, strict=True):
        kept = {name: of_run[k - 1].associations if k <= len(of_run) else {} for name, of_run in moments.items()}
        shown = _histories(kept, run.associations[:k])
        most = max(most, len(shown))
        for place, (name, probabilities) in enumerate(kept.items()):
            heights = [probabilities.get(history, 0.0) for history in shown]
            offsets = np.arange(len(shown)) + (place - 0.5 * (len(moments) - 1)) * width
            axis.bar(offsets, heights, width, color=WITHOUT if "without" in name else WITH, label=name)
        at = shown.index(run.associations[:k])
        axis.plot(at, 1.06, "o", color=TRUTH, markersize=8, fillstyle="none", label="the true one")
        axis.set(title=f"k = {k}", ylim=(0.0, 1.12), xlabel="association history")
        axis.set_xticks(range(len(shown)), [str(n + 1) for n in range(len(shown))])
        _bare(axis)
    for axis in canvas.axes:
        axis.set_xlim(-0.6, most - 0.4)
    canvas.axes[0].set_ylabel("P(association history)")
    canvas.axes[-1].legend(fontsize=8, frameon=False)
    canvas.savefig(file, dpi=100)
    return file


def disambiguation_figure(file: Path, moments: Mapping[str, Sequence[Moment]]) -> Path:
    """PNG of the number of components, the entropy over associations and P(true association) over the keyframes."""
    panels = {
        "num_hypotheses": "components",
        "association_entropy": "H over associations [nats]",
        "p_true_association": "P(true association)",
    }
    canvas = Canvas(figsize=(13, 3.2), layout="constrained")
    for axis, (metric, label) in zip(canvas.subplots(1, len(panels)), panels.items(), strict=True):
        for name, of_run in moments.items():
            values = [getattr(moment, metric) for moment in of_run]
            colour = WITHOUT if "without" in name else WITH
            axis.plot(range(1, len(values) + 1), values, ".-", color=colour, linewidth=1.5, label=name)
        axis.set(xlabel="keyframe k", ylabel=label)
        axis.set_ylim(bottom=0.0)
        _bare(axis)
    canvas.axes[0].legend(fontsize=8, frameon=False)
    canvas.savefig(file, dpi=110)
    return file


def _bounds(run: Run, moments: Mapping[str, Sequence[Moment]]) -> list[tuple[float, float]]:
    """Ranges of x and y [m] that hold the objects, the track and what the components make of the robot."""
    believed = [moment.poses[:, :2] for of_run in moments.values() for moment in of_run]
    points = np.vstack([run.scenario.objects[:, :2], run.poses[:, :2], *believed])
    return [(low - 3.0, high + 3.0) for low, high in zip(points.min(axis=0), points.max(axis=0), strict=True)]


def _histories(kept: Mapping[str, Mapping[History, float]], truth: History) -> list[History]:
    """The likeliest histories of any method in their order, the true one among them."""
    greatest: dict[History, float] = {truth: 0.0}
    for probabilities in kept.values():
        for history, probability in probabilities.items():
            greatest[history] = max(greatest.get(history, 0.0), probability)
    ordered = sorted(greatest, key=lambda history: (-greatest[history], history))
    shown = ordered[:MOST_BARS]
    return shown if truth in shown else [*shown[:-1], truth]


def _components(axis: Axes, moment: Moment, colour: str) -> None:
    """One- and two-sigma ellipses of the position and the heading of every component."""
    states, weights = planar_from_pose_vector(moment.poses), np.exp(moment.log_weights)
    for state, weight, (major, minor, angle) in zip(states, weights, ellipses(moment.pose_covariances), strict=True):
        strength = 0.25 + 0.75 * float(weight)
        for sigmas in (1.0, 2.0):
            size = (2.0 * sigmas * major, 2.0 * sigmas * minor)
            shape = Ellipse(tuple(state[:2]), *size, angle=np.degrees(angle), fill=False, color=colour)
            shape.set(linewidth=0.5 + 1.3 * float(weight), alpha=strength)
            axis.add_patch(shape)
        _robot(axis, state, colour, alpha=strength)


def _robot(axis: Axes, state: Array, colour: str, alpha: float = 1.0) -> None:
    axis.plot(state[0], state[1], ".", color=colour, alpha=alpha, markersize=5)
    axis.quiver(state[0], state[1], np.cos(state[2]), np.sin(state[2]), color=colour, alpha=alpha, **_quiver(1.8))


def _quiver(length_m: float) -> dict[str, Any]:
    return {"angles": "xy", "scale_units": "xy", "scale": 1.0 / length_m, "width": 0.004, "headwidth": 3.0}


def _method_colours(names: Sequence[str]) -> dict[str, Any]:
    """Red without semantics, darker for larger alpha; what differs in more than alpha in the colour of its alpha."""
    strengths = [name for name in names if "without" not in name and not _is_variant(name)]
    shades = colormaps["viridis_r"](np.linspace(0.12, 1.0, len(strengths))) if len(strengths) > 1 else [WITH]
    found: dict[str, Any] = dict(zip(strengths, shades, strict=True))
    for name in names:
        if _is_variant(name):
            found[name] = found[name.split(",")[0]]
        elif "without" in name:
            found[name] = WITHOUT
    return found


def _is_variant(name: str) -> bool:
    return any(word in name for word in VARIANTS)


def _array(values: Sequence[float | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values])


def _bare(axis: Axes) -> None:
    axis.spines[["top", "right"]].set_visible(False)
