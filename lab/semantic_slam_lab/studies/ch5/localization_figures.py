"""Pictures of tracks around objects."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas

from semantic_slam_lab.studies.ch5.models import WORDS
from semantic_slam_lab.studies.ch5.tracks import Located

TRUTH, DEAD_RECKONING, ESTIMATE, NEW = "#222222", "#c0392b", "#1f5fae", "#d98a1f"


def example_figure(file: Path, run: Located, formulation: str) -> Path:
    """PNG: the track from above, and its errors."""
    canvas = Canvas(figsize=(12, 5.4), layout="constrained")
    left, right = canvas.subplots(1, 2)
    lines = (
        ("truth", run.truth, TRUTH),
        ("dead reckoning", run.dead_reckoning, DEAD_RECKONING),
        ("with the learned factor", run.estimates[formulation].poses, ESTIMATE),
    )
    for label, track, colour in lines:
        left.plot(track[:, 0], track[:, 1], ".-", color=colour, label=label, linewidth=1.5, markersize=4)
    left.plot(0.0, 0.0, "s", color="#2c8a3d", markersize=12, label="object")
    left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    left.legend(frameon=False, fontsize=9)
    right.plot(run.error_m["dead_reckoning"], color=DEAD_RECKONING, label="dead reckoning")
    right.plot(run.error_m[formulation], color=ESTIMATE, label="with the learned factor")
    right.set(xlabel="pose along the track", ylabel="position error [m]", ylim=(0.0, None))
    right.legend(frameon=False, fontsize=9)
    canvas.savefig(file, dpi=110)
    return file


def errors_figure(file: Path, known: Sequence[Located], new: Sequence[Located], formulations: Sequence[str]) -> Path:
    """PNG: a point for each track, a panel for each formulation."""
    canvas = Canvas(figsize=(14, 5.2), layout="constrained")
    for axis, name in zip(canvas.subplots(1, len(formulations), sharey=True), formulations, strict=True):
        for runs, colour, label in ((known, ESTIMATE, "trained on"), (new, NEW, "new instances")):
            before = [run.error_m["dead_reckoning"].mean() for run in runs]
            axis.plot(before, [run.error_m[name].mean() for run in runs], "o", color=colour, label=label, markersize=5)
        most = max(run.error_m["dead_reckoning"].mean() for run in (*known, *new))
        ends = np.array([0.0, 1.05 * most])
        axis.plot(ends, ends, color="#bbbbbb", linewidth=1.0)
        axis.plot(ends, ends / 3.0, color="#2c8a3d", linewidth=1.2)
        axis.set(title=WORDS[name], xlabel="dead reckoning: mean error [m]", ylabel="with the learned factor [m]")
        axis.legend(frameon=False, fontsize=9)
    canvas.savefig(file, dpi=110)
    return file
