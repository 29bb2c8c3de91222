"""What the replays show: claims, a table and a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Figure, Table

SAME = 1e-9
"""Difference up to which two beliefs count as equal."""
COLOURS = {1: "#1f5fae", 2: "#c0392b"}

Rows = Sequence[dict[str, Any]]


def claims_of(rows: Rows) -> list[Claim]:
    """Equality, completion, growth with the map, worth of a second backend."""
    return [_equal(rows), _complete(rows), _growth(rows), _faster(rows)]


def _equal(rows: Rows) -> Claim:
    double = [row for row in rows if row["backends"] > 1]
    compared = sum(row["keyframes_compared"] for row in double)
    largest = max((row["belief_difference"] for row in double if row["keyframes_compared"]), default=np.inf)
    return Claim(
        text="Two backends state the same belief as one",
        source=REQUIREMENT,
        thesis="",
        measured=f"largest difference of any number: {largest:.2g}, over {compared} keyframes",
        holds=bool(compared and largest <= SAME),
    )


def _complete(rows: Rows) -> Claim:
    reached = [
        f"{row['objects']} objects, {row['backends']}: {row['keyframes']}/{row['keyframes_wanted']}" for row in rows
    ]
    return Claim(
        text="Every replay reaches its last keyframe within the limit",
        source=REQUIREMENT,
        thesis="",
        measured="; ".join(reached),
        holds=all(row["finished"] for row in rows),
    )


def _growth(rows: Rows) -> Claim:
    single = [row for row in rows if row["backends"] == 1]
    done = [row for row in single if row["ms_per_keyframe_p50"] is not None]
    times = [f"{row['objects']}: {row['ms_per_keyframe_p50']:.4g} ms" for row in done]
    exponent, fit = np.inf, "no exponent"
    if len(done) > 1:
        sizes, medians = (np.log([row[name] for row in done]) for name in ("objects", "cpu_ms_per_keyframe_p50"))
        exponent = float(np.polyfit(sizes, medians, 1)[0])
        fit = f"exponent of the CPU time {exponent:.2f}"
    missing = [f"{row['objects']}: not one keyframe" for row in single if row["ms_per_keyframe_p50"] is None]
    return Claim(
        text="Time per keyframe grows more slowly than the map while what is in sight stays the same",
        source=REQUIREMENT,
        thesis="",
        measured=f"{', '.join([*times, *missing])} (one backend); {fit}",
        holds=bool(exponent < 1.0 and not missing),
    )


def _faster(rows: Rows) -> Claim:
    double = [row for row in rows if row["backends"] > 1 and row["speedup"] is not None]
    found = [
        f"{row['objects']} objects, {row['hypotheses_mean']:.0f} hypotheses: {row['speedup']:.2f}x"
        f" (CPU time of the slower backend {row['cpu_speedup']:.2f}x less)"
        for row in double
    ]
    return Claim(
        text="A second backend makes keyframes faster",
        source=REQUIREMENT,
        thesis="",
        measured="; ".join(found) or "nothing to compare",
        holds=bool(double) and all(row["speedup"] > 1.0 for row in double),
    )


def table_of(rows: Rows) -> Table:
    """All replays."""
    columns = {
        "objects": "objects",
        "backends": "backends",
        "keyframes": "keyframes",
        "ms_per_keyframe_p50": "ms per keyframe, median",
        "cpu_ms_per_keyframe_p50": "CPU ms, slower backend",
        "speedup": "speed-up",
        "hypotheses_mean": "hypotheses",
        "association_right": "heaviest right",
        "peak_rss_mb": "MB, all backends",
        "belief_difference": "difference",
    }
    cells = tuple(tuple(_text(row[name]) for name in columns) for row in rows)
    return Table("Replays", tuple(columns.values()), cells)


def figure_of(file: Path, rows: Rows) -> Figure:
    """PNG: time per keyframe and memory against the size of the map."""
    canvas = Canvas(figsize=(11, 4.2), layout="constrained")
    left, right = canvas.subplots(1, 2)
    _curves(left, rows, "ms_per_keyframe_p50")
    left.set(ylabel="ms per keyframe, median", yscale="log")
    _curves(right, rows, "peak_rss_mb")
    right.set(ylabel="MB of all backends, peak", ylim=(0.0, 1.1 * max((row["peak_rss_mb"] or 1.0) for row in rows)))
    canvas.savefig(file, dpi=110)
    text = "The same drive through ever larger maps. A point that is missing was not reached within the limit."
    return Figure("Time and memory", text, file)


def _curves(axis: Axes, rows: Rows, name: str) -> None:
    for number, colour in COLOURS.items():
        points = [(row["objects"], row[name]) for row in rows if row["backends"] == number and row[name] is not None]
        label = f"{number} backend{'s' if number > 1 else ''}"
        axis.plot(*np.reshape(points, (-1, 2)).T, "o-", color=colour, label=label)
    sizes = sorted({row["objects"] for row in rows})
    axis.set(xlabel="objects in the map", xscale="log", xlim=(0.7 * sizes[0], 1.4 * sizes[-1]))
    axis.set_xticks(sizes, labels=[str(size) for size in sizes])
    axis.minorticks_off()
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False)


def _text(value: Any) -> str:
    return "–" if value is None else f"{value:.4g}"
