"""Pictures of chapter 3: scores along a track, and how metrics spread over the realisations at each step."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from semantic_slam.geometry.arrays import Array

COLOURS = {
    "ours": "#1f5fae",
    "recursive": "#7b3fa0",
    "joint": "#0b8f9c",
    "model_based": "#2c8a3d",
    "simple_bayes": "#c0392b",
}
FAN_METRICS = {"p_true": "probability of the true class", "log_mgr": "log MGR [nats]", "msde": "MSDE"}


def fan_figure(
    file: Path, fans: Mapping[str, Mapping[str, Any]], rows: Sequence[tuple[str, ...]], guess: float
) -> Path:
    """PNG with a row per comparison of methods and a column per metric; returns ``file``.

    ``fans`` is method -> metric -> K x 9 percentiles (10 ... 90); ``guess`` the probability of a class by the prior.
    """
    canvas = Canvas(figsize=(12, 3.1 * len(rows)), layout="constrained")
    axes = canvas.subplots(len(rows), len(FAN_METRICS), sharex=True, squeeze=False)
    for line, methods in zip(axes, rows, strict=True):
        for axis, (metric, label) in zip(line, FAN_METRICS.items(), strict=True):
            for method in methods:
                draw_fan(axis, fans[method][metric], COLOURS[method], method.replace("_", " "))
            axis.set_ylabel(label)
            if metric == "p_true":
                axis.axhline(guess, color="#555", linestyle="--", linewidth=0.8)
                axis.set_ylim(-0.02, 1.02)
                axis.legend(loc="best", fontsize=8, frameon=False)
            if metric == "log_mgr" and max(max(step) for method in methods for step in fans[method][metric]) > 20.0:
                axis.set_yscale("symlog", linthresh=1.0)
                axis.set_ylim(bottom=0.0)
    for axis in axes[-1]:
        axis.set_xlabel("step")
    canvas.savefig(file, dpi=110)
    return file


def draw_fan(axis: Axes, percentiles: Sequence[Sequence[float]], colour: str, label: str) -> None:
    """Bands between the 10th and 90th, 20th and 80th ... percentile, each darker, and the median."""
    columns = list(zip(*percentiles, strict=True))
    steps = range(len(percentiles))
    for low in range(len(columns) // 2):
        axis.fill_between(steps, columns[low], columns[-1 - low], color=colour, alpha=0.14, linewidth=0)
    axis.plot(steps, columns[len(columns) // 2], color=colour, linewidth=1.6, label=label)
    axis.spines[["top", "right"]].set_visible(False)


def scores_figure(file: Path, mean: Array, covariance: Array, true_class: int, noised: Array) -> Path:
    """PNG of Fig. 3.2: (C, K, F) mean and (C, F, K, K) covariance of the processes, and (K, F) measured scores."""
    canvas = Canvas(figsize=(12, 3.4), layout="constrained")
    plane, *components = canvas.subplots(1, 3)
    steps = np.arange(len(noised))
    plane.plot(*mean[true_class, :, :2].T, color=COLOURS["ours"], linewidth=1.0)
    plane.scatter(*mean[true_class, :, :2].T, c=steps, cmap="Blues", s=22, vmin=-8, label="mean of the true class")
    plane.scatter(*noised[:, :2].T, c=steps, cmap="Reds", s=22, vmin=-8, marker="x", label="noised scores")
    plane.set(xlabel="score 1", ylabel="score 2")
    plane.legend(fontsize=8, frameon=False)
    for f, axis in enumerate(components):
        sigma = np.sqrt(np.diagonal(covariance[true_class, f]))
        centre = mean[true_class, :, f]
        axis.fill_between(steps, centre - 2 * sigma, centre + 2 * sigma, color=COLOURS["ours"], alpha=0.18, linewidth=0)
        axis.plot(steps, centre, color=COLOURS["ours"])
        axis.plot(steps, noised[:, f], "x", color=COLOURS["simple_bayes"])
        axis.set(xlabel="step", ylabel=f"score {f + 1}")
    for axis in (plane, *components):
        axis.spines[["top", "right"]].set_visible(False)
    canvas.savefig(file, dpi=110)
    return file


def aliasing_figure(file: Path, scores: Array, means: Sequence[Array], true_class: int) -> Path:
    """PNG of Fig. 3.4: (K, F) scores against the (C, K, F) means at the true track and at the believed one."""
    canvas = Canvas(figsize=(12, 3.4), layout="constrained")
    titles = ("where the camera is", "where it is believed to be")
    steps = np.arange(len(scores))
    for axis, of_track, title in zip(canvas.subplots(1, 2, sharey=True), means, titles, strict=True):
        for c, mean in enumerate(of_track):
            style = {"linewidth": 2.2} if c == true_class else {"linewidth": 1.2, "linestyle": "--"}
            axis.plot(steps, mean[:, 1], label=f"class {c + 1}" + (" (true)" if c == true_class else ""), **style)
        axis.plot(steps, scores[:, 1], "x", color=COLOURS["simple_bayes"], label="scores")
        axis.set(xlabel="step", ylabel="score 2", title=title)
        axis.spines[["top", "right"]].set_visible(False)
        axis.legend(fontsize=8, frameon=False)
    canvas.savefig(file, dpi=110)
    return file
