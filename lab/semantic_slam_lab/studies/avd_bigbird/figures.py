"""Figures 3.14 and 3.16 to 3.18 of the study on a scene and turntables."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure as Canvas

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.report.drawing.palette import class_colours
from semantic_slam_lab.studies.avd_bigbird.data import SceneTrack, in_object_frame
from semantic_slam_lab.studies.avd_bigbird.models import TurntableScores
from semantic_slam_lab.studies.rendered.figures import BANDS, COLOURS

DPI = 110


def layout(file: Path, places_m: Array, track: SceneTrack, bias_m: Array, crops: Sequence[Bytes]) -> Path:
    """PNG: all (N, 2) cameras of the scene, the views chosen by their number, the estimate, and what they show."""
    count = len(crops)
    columns = max(count, 6)
    canvas = Canvas(figsize=(1.35 * columns, 7.2), layout="constrained")
    grid = canvas.add_gridspec(2, columns, height_ratios=(4.0, 1.0))
    axis = canvas.add_subplot(grid[0, :])
    relative = in_object_frame(places_m, track.planar)
    axis.scatter(relative[:, 0], relative[:, 1], s=5, color="#9bbbe0", label="cameras of the scene")
    axis.plot(*track.locations_m.T, "o", color="#1f5fae", label="views chosen")
    axis.plot(*(track.locations_m + bias_m).T, "x", color="#c0392b", label="where they are believed to be")
    for index, place in enumerate(track.locations_m):
        axis.annotate("", (0.82 * place), place, arrowprops={"arrowstyle": "->", "color": "#1f5fae"})
        axis.text(1.08 * place[0], 1.08 * place[1], str(index), fontsize=9, ha="center", va="center")
    axis.plot(0.0, 0.0, "ko", markersize=9)
    axis.set(aspect="equal", xlabel="x of the object (its front) [m]", ylabel="y of the object [m]")
    axis.legend(fontsize=8, loc="best")
    for index, crop in enumerate(crops):
        _picture(canvas.add_subplot(grid[1, index]), crop, str(index))
    return _saved(canvas, file)


def class_models(
    file: Path,
    measured: Sequence[TurntableScores],
    sets: Mapping[str, tuple[Sequence[int], Array]],
    score_names: Sequence[str],
) -> Path:
    """PNG: per class its picture, the ring of means, and rasters; ``sets``: title -> components, (C, n, n, F) maps."""
    canvas = Canvas(figsize=(2.6 * len(measured), 2.6 * (1 + len(sets)) + 0.6), layout="constrained")
    axes = canvas.subplots(1 + len(sets), len(measured), squeeze=False)
    for axis, of in zip(axes[0], measured, strict=True):
        _picture(axis, of.picture, of.class_name)
    palette = np.array([to_rgb(colour) for colour in class_colours(len(score_names))])
    for line, (title, (components, maps)) in zip(axes[1:], sets.items(), strict=True):
        for axis, values, of in zip(line, maps, measured, strict=True):
            axis.imshow(mixed(values, palette[list(components)]), origin="lower", extent=(-1.25, 1.25, -1.25, 1.25))
            at_training = mixed(of.samples.mean(axis=1)[:, list(components)], palette[list(components)])
            axis.scatter(*(1.1 * of.directions).T, c=at_training, s=16, edgecolors="white", linewidths=0.3)
            axis.set(xticks=[-1, 0, 1], yticks=[-1, 0, 1])
        line[0].set_ylabel(title, fontsize=9)
    handles = [canvas.axes[0].plot([], [], "s", color=colour)[0] for colour in palette]
    canvas.legend(handles, list(score_names), loc="outside lower center", ncols=len(score_names), fontsize=8)
    return _saved(canvas, file)


def track_fans(file: Path, single: Mapping[str, Array], many: Mapping[str, Array], true_class: int) -> Path:
    """PNG: the bias alone, (K, C) log posteriors by method, beside the fans of (N, K, C)."""
    canvas = Canvas(figsize=(4.1 * (1 + len(many)), 6.0), layout="constrained")
    axes = canvas.subplots(2, 1 + len(many), squeeze=False)
    for name, logs in single.items():
        style = {"color": COLOURS[name], "label": name.replace("_", " "), "marker": "o", "markersize": 3}
        axes[0, 0].plot(np.exp(logs[:, true_class]), **style)
        axes[1, 0].plot(_log_mgr(logs, true_class), **style)
    axes[0, 0].set_title("with the bias alone")
    axes[0, 0].legend(fontsize=8, frameon=False)
    for column, (name, logs) in enumerate(many.items(), start=1):
        _fan(axes[0, column], np.exp(logs[..., true_class]), COLOURS[name])
        _fan(axes[1, column], _log_mgr(logs, true_class), COLOURS[name])
        axes[0, column].set_title(name.replace("_", " "))
    top = max(1.0, *(axis.get_ylim()[1] for axis in axes[1]))
    for upper, lower in axes.T:
        upper.axhline(1.0 / next(iter(single.values())).shape[-1], color="#555", linestyle="--", linewidth=0.8)
        upper.set(ylim=(-0.02, 1.02), ylabel="P(true class)")
        lower.set(yscale="symlog", ylim=(0.0, top), ylabel="log MGR [nats]", xlabel="view")
    return _saved(canvas, file)


def bias_maps(file: Path, maps: Array, half_width_m: float, bias_m: Array, class_names: Sequence[str]) -> Path:
    """PNG with a panel per view of (K, n, n, C) class posteriors over the location's bias; a cross at ``bias_m``."""
    columns = min(len(maps), 5)
    rows = -(-len(maps) // columns)
    canvas = Canvas(figsize=(2.7 * columns, 2.8 * rows + 0.4), layout="constrained")
    palette = np.array([to_rgb(colour) for colour in class_colours(len(class_names))])
    axes = canvas.subplots(rows, columns, squeeze=False).ravel()
    extent = 100.0 * half_width_m * np.array([-1.0, 1.0, -1.0, 1.0])
    for index, axis in enumerate(axes):
        axis.set_visible(index < len(maps))
        if index < len(maps):
            axis.imshow(mixed(maps[index], palette), origin="lower", extent=extent)
            axis.plot(0.0, 0.0, "+", color="black")
            axis.plot(*(100.0 * bias_m), "x", color="white", markeredgewidth=2)
            axis.set_title(f"view {index}", fontsize=9)
    axes[0].set(xlabel="bias in x [cm]", ylabel="bias in y [cm]")
    handles = [axes[0].plot([], [], "s", color=colour)[0] for colour in palette]
    canvas.legend(handles, list(class_names), loc="outside lower center", ncols=len(class_names), fontsize=8)
    return _saved(canvas, file)


def mixed(values: Array, palette: Array) -> Array:
    """(..., 3) colours mixed by (..., F) values, that need not sum to one, from an (F, 3) palette."""
    shares = np.clip(values, 1e-6, None)
    return np.asarray(np.clip(shares / shares.sum(axis=-1, keepdims=True) @ palette, 0.0, 1.0))


def _log_mgr(logs: Array, true_class: int) -> Array:
    return np.asarray(logs.max(axis=-1) - logs[..., true_class])


def _fan(axis: Axes, values: Array, colour: str) -> None:
    steps = np.arange(values.shape[1])
    for low in BANDS:
        axis.fill_between(
            steps, *np.percentile(values, (low, 100 - low), axis=0), color=colour, alpha=0.14, linewidth=0
        )
    axis.plot(steps, np.median(values, axis=0), color=colour, linewidth=1.6)
    axis.spines[["top", "right"]].set_visible(False)


def _picture(axis: Axes, picture: Bytes, title: str) -> None:
    axis.imshow(picture)
    axis.set(xticks=[], yticks=[])
    axis.set_title(title, fontsize=9)


def _saved(canvas: Canvas, file: Path) -> Path:
    canvas.savefig(file, dpi=DPI)
    return file
