"""Figures of the rendered experiments."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure as Canvas
from matplotlib.image import AxesImage
from matplotlib.patches import Circle
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.report.drawing.palette import class_colours
from semantic_slam_lab.studies.rendered.views import CLASSES, LEAST_RANGE_M

COLOURS = {
    "ours": "#1f5fae",
    "joint": "#0b8f9c",
    "joint_kernel": "#59b7c2",
    "recursive": "#7b3fa0",
    "model_based": "#2c8a3d",
    "model_based_kernel": "#9bb53c",
    "simple_bayes": "#c0392b",
}
BANDS = (10, 20, 30, 40)
"""Percentiles, and their complements, between which a fan is drawn."""
CLASS_COLOURS = np.array([to_rgb(colour) for colour in class_colours(len(CLASSES))])
BINS = 15
LEAST_SHARE = 0.005
"""Least share of all answers in a bin of the plot: bins with fewer are not drawn."""


def class_maps(
    file: Path, maps: Mapping[str, Array], half_width_m: float, tracks: Mapping[str, Array] | None = None
) -> Path:
    """PNG with a panel per name of (n, n, C) class scores over position (rows are y): colours mixed by them."""
    canvas = Canvas(figsize=(4.0 * len(maps), 4.3), layout="constrained")
    for axis, (title, scores) in zip(canvas.subplots(1, len(maps), squeeze=False)[0], maps.items(), strict=True):
        shares = np.clip(scores, 0.0, None)
        picture = np.clip(shares / shares.sum(axis=-1, keepdims=True) @ CLASS_COLOURS, 0.0, 1.0)
        _map(axis, picture, half_width_m, title)
        _draw_tracks(axis, tracks or {})
    for name, colour in zip(CLASSES, CLASS_COLOURS, strict=True):
        canvas.axes[0].plot([], [], "s", color=colour, label=name)
    canvas.axes[0].legend(fontsize=8, loc="upper left")
    canvas.savefig(file, dpi=110)
    return file


def uncertainty_maps(file: Path, maps: Mapping[str, Array], half_width_m: float, tracks: Mapping[str, Array]) -> Path:
    """PNG with a panel per (n, n) map of dropout's spread, NaN where too near, and (K, 2) tracks by their colour."""
    canvas = Canvas(figsize=(5.0 * len(maps), 4.6), layout="constrained")
    greatest = max(float(np.nanmax(values)) for values in maps.values())
    for axis, (title, values) in zip(canvas.subplots(1, len(maps), squeeze=False)[0], maps.items(), strict=True):
        shown = _map(axis, values, half_width_m, title, vmin=0.0, vmax=greatest, cmap="viridis")
        _draw_tracks(axis, tracks)
    canvas.colorbar(shown, ax=canvas.axes, label="standard deviation, summed over the classes")
    canvas.savefig(file, dpi=110)
    return file


def fans(file: Path, rows: Mapping[str, Mapping[str, Array]], true_class: int) -> Path:
    """PNG with a row per name of method -> (N, K, C) log posteriors: P(true class) by method, and all log MGRs."""
    methods = next(iter(rows.values()))
    canvas = Canvas(figsize=(4.2 * (len(methods) + 1), 2.9 * len(rows)), layout="constrained")
    for line, (title, outcomes) in zip(
        canvas.subplots(len(rows), len(methods) + 1, squeeze=False), rows.items(), strict=True
    ):
        for axis, (name, logs) in zip(line, outcomes.items(), strict=False):
            label = name.replace("_", " ")
            _fan(axis, np.exp(logs[..., true_class]), COLOURS[name], label)
            _fan(line[-1], logs.max(axis=-1) - logs[..., true_class], COLOURS[name], label)
            axis.axhline(1.0 / len(CLASSES), color="#555", linestyle="--", linewidth=0.8)
            axis.set(title=f"{title}: {label}", ylabel="P(true class)", ylim=(-0.02, 1.02), xlabel="view")
        line[-1].set(title=title, yscale="symlog", ylabel="log MGR [nats]", xlabel="view")
        line[-1].set_ylim(0.0, max(line[-1].get_ylim()[1], 1.0))
        line[-1].legend(fontsize=8, frameon=False)
    canvas.savefig(file, dpi=110)
    return file


def reliability(file: Path, settings: Mapping[str, Mapping[str, Array]], true_class: int) -> Path:
    """PNG with a panel per setting: share of right answers against confidence; a dot's area is its bin's share."""
    canvas = Canvas(figsize=(5.2 * len(settings), 4.6), layout="constrained")
    for axis, (title, methods) in zip(
        canvas.subplots(1, len(settings), squeeze=False)[0], settings.items(), strict=True
    ):
        axis.plot([0, 1], [0, 1], color="#999", linewidth=0.8)
        for name, logs in methods.items():
            confidence, right, count = reliability_bins(logs, true_class)
            used = count >= LEAST_SHARE * count.sum()
            axis.plot(confidence[used], right[used], color=COLOURS[name], linewidth=1.0, label=name.replace("_", " "))
            axis.scatter(
                confidence[used], right[used], 200.0 * count[used] / count.sum(), color=COLOURS[name], alpha=0.6
            )
        axis.set(title=title, xlabel="confidence", ylabel="right", xlim=(0.3, 1.02), ylim=(-0.02, 1.02))
        axis.legend(fontsize=8, frameon=False)
    canvas.savefig(file, dpi=110)
    return file


def reliability_bins(log_posteriors: Array, true_class: int) -> tuple[Array, Array, Array]:
    """Mean confidence, share of right answers and number of answers in each of the (BINS,) bins of confidence."""
    flat = log_posteriors.reshape(-1, log_posteriors.shape[-1])
    confidence, right = np.exp(flat.max(axis=-1)), flat.argmax(axis=-1) == true_class
    bin_of = np.clip(np.ceil(confidence * BINS).astype(int) - 1, 0, BINS - 1)
    count = np.bincount(bin_of, minlength=BINS)
    sums = [np.bincount(bin_of, weights=values, minlength=BINS) for values in (confidence, right)]
    return sums[0] / np.maximum(count, 1), sums[1] / np.maximum(count, 1), count.astype(np.float64)


def gallery(file: Path, rows: Mapping[str, Sequence[NDArray[np.uint8]]], titles: Sequence[str]) -> Path:
    """PNG with a row of pictures per name."""
    count = len(titles)
    canvas = Canvas(figsize=(1.5 * count, 1.65 * len(rows)), layout="constrained")
    for line, (name, images) in zip(canvas.subplots(len(rows), count, squeeze=False), rows.items(), strict=True):
        for axis, image, title in zip(line, images, titles, strict=True):
            axis.imshow(image)
            axis.set(xticks=[], yticks=[])
            axis.set_title(title, fontsize=8)
        line[0].set_ylabel(name, fontsize=8)
    canvas.savefig(file, dpi=110)
    return file


def mark_object(axis: Axes) -> None:
    """The object at the origin, its front to the right."""
    axis.add_patch(_circle())
    axis.annotate("", (0.75, 0.0), (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": "#333"})
    axis.text(0.0, -0.45, "object,\nfront →", fontsize=7, ha="center", va="center", color="#333")


def _draw_tracks(axis: Axes, tracks: Mapping[str, Array]) -> None:
    """Draw (K, 2) tracks by their colour."""
    for colour, track in tracks.items():
        axis.plot(*track.T, "o-", color=colour, markersize=3, linewidth=1.2)


def _circle() -> Circle:
    return Circle((0.0, 0.0), LEAST_RANGE_M, facecolor="white", edgecolor="none")


def _map(axis: Axes, values: Array, half_width_m: float, title: str, **style: Any) -> AxesImage:
    extent = (-half_width_m, half_width_m, -half_width_m, half_width_m)
    shown = axis.imshow(values, origin="lower", extent=extent, interpolation="nearest", **style)
    mark_object(axis)
    axis.set(title=title, xlabel="x [m]", ylabel="y [m]")
    return shown


def _fan(axis: Axes, values: Array, colour: str, label: str) -> None:
    steps = np.arange(1, values.shape[1] + 1)
    for low in BANDS:
        lower, upper = np.percentile(values, (low, 100 - low), axis=0)
        axis.fill_between(steps, lower, upper, color=colour, alpha=0.14, linewidth=0)
    axis.plot(steps, np.median(values, axis=0), color=colour, linewidth=1.6, label=label)
    axis.spines[["top", "right"]].set_visible(False)
