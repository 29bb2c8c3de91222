"""Claims, tables and figures of the study of rooms without a map."""

from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam_lab.studies.aliased_room.scores import METRICS
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Figure, Table

WORDS = {
    "ours": "open world (ours)",
    "max_mixture": "max-mixture",
    "nearest_neighbour": "nearest neighbour",
    "no_semantics": "DA-BSP (geometry only)",
    "hybrid_smoother": "HybridSmoother",
}
LINES = {
    "default": "10 % clutter, 10 % misses",
    "slippery": "the same, odometry noise times 3",
}
LEAST_NATS = 1e-3
"""By which a class NLL has to be the smaller one: below that all say the true class for certain."""
DEFINITIONS = (
    ("GOSPA", "p = 2, c = 2 m, alpha = 2, in metres, of the objects whose existence at the end exceeds one half:"
     " root of (squared distances of the pairs + 2 m^2 for each missing and each false object)"),
    ("ghost", "an object with existence > 0.5 at the end that stands for no true one: pairs are one to one and within"
     " 1 m, so that a second copy of a true object is a ghost, too"),
    ("missing", "a true object that no object with existence > 0.5 stands for"),
    ("class NLL", "mean over the true objects of -ln P(true class) of the object that stands for it; the even"
     " distribution where it is missing. Methods without class models get the normalised product of the network's"
     " scores, each at least 0.01, of the detections associated with the object"),
    ("class ECE", "mean |accuracy - confidence| over 15 bins of the largest class probability, over all runs"),
    ("association F1", "pairs of detections of one object, under the hypothesis that is best at the end; clutter is in"
     " no pair"),
    ("NEES", "of the robot's x, y, yaw at each keyframe, moments of all hypotheses, mean over keyframes: 3 when"
     " consistent"),
    ("ATE", "root mean square distance of the smoothed positions of the hypothesis best at the end, in map, which is"
     " where the robot starts, unaligned"),
)  # fmt: skip
SETTING = (
    ("scenes", "rendered AVD-format rooms: eight pieces of furniture on a nearly regular grid, 5 classes, 3 of them"
     " twice and identical; the shipped network measures every box, depth gives the range. No map; the start is known"
     " (0.01 m)"),
    ("runs", "a room is rendered and measured once and shared by its runs; what each run draws for itself, by its own"
     " key, is odometry noise, misses and false alarms"),
    ("misses", "every true detection is dropped with probability 0.1"),
    ("clutter", "false alarms per frame are Poisson, so many that 10 % of all detections are false on average; evenly"
     " over the ground in front of the camera (0.8 to 4.5 m, 74 degrees), with the network's answer to a detection"
     " drawn from the whole drive: they look like furniture"),
    ("front end", "births, clutter, gate, region and existence are one and the same for all methods, at the stated"
     " rates; a first detection leaves an existence below one half. It was set on rooms 0, 101 and 102, which are not"
     " among these"),
    ("max-mixture", "our engine, classes included, with a single hypothesis kept: the best joint assignment at each"
     " keyframe. Its classes are the same tables as ours"),
    ("nearest neighbour", "each detection takes the nearest object inside the gate; classes by the product of scores"),
    ("DA-BSP", "our engine without class models, as many hypotheses as ours; classes by the product of scores"),
    ("HybridSmoother", "GTSAM's, with 10 leaves. It has neither births nor existence: a detection near no landmark"
     " starts one, else a discrete variable chooses among the three nearest and none, and the front end's existence"
     " follows its best associations. It takes detections one by one (joint options run out of time) and cannot say"
     " that one object takes one detection; classes by the product of scores"),
)  # fmt: skip


def claims_of(result: dict[str, Any]) -> list[Claim]:
    """What the open world has to reach, on each line."""
    return [claim for line in result["lines"] for claim in _claims(line, result["lines"][line], result["num_runs"])]


def _claims(line: str, methods: dict[str, Any], num_runs: dict[str, int]) -> list[Claim]:
    ours, count = methods["ours"], num_runs[line]
    source = REQUIREMENT if line == "default" else "project: a harder line"
    found = [
        ("No ghost with existence > 0.5 in 95 % of the runs", ours["runs_without_ghost"], 0.95),
        ("Every true object present in every run", ours["runs_complete"], 1.0),
    ]
    claims = [
        Claim(f"{text} ({LINES[line]})", source, "", f"{share:.1%} of {count} runs", bool(share >= least))
        for text, share, least in found
    ]
    for name, words, least in (("gospa_m", "GOSPA", 0.0), ("nll", "Class NLL", LEAST_NATS)):
        others = {WORDS[method]: row[name] for method, row in methods.items() if method != "ours"}
        measured = f"{ours[name]:.3g} against {', '.join(f'{value:.3g} {other}' for other, value in others.items())}"
        holds = all(ours[name] < value - least for value in others.values())
        claims.append(Claim(f"{words} better than every baseline ({LINES[line]})", source, "", measured, holds))
    return claims


def tables_of(result: dict[str, Any]) -> list[Table]:
    """The methods on each line, then what the words mean."""
    tables = [
        Table(f"{LINES[line]}: means over {result['num_runs'][line]} runs", ("", *METRICS.values()), _rows(methods))
        for line, methods in result["lines"].items()
    ]
    return [*tables, Table("What is measured", ("", ""), DEFINITIONS), Table("What was run", ("", ""), SETTING)]


def _rows(methods: dict[str, Any]) -> tuple[tuple[str, ...], ...]:
    return tuple((WORDS[method], *(_number(name, row[name]) for name in METRICS)) for method, row in methods.items())


def _number(name: str, value: float) -> str:
    if name.startswith("runs_"):
        return f"{value:.1%}"
    if name == "faults":
        return f"{value:.0f}"
    return f"{value:.3g}" if name in ("nll", "ece") else f"{value:.3f}"


def figures_of(out: Path, result: dict[str, Any]) -> list[Figure]:
    """Every run's GOSPA and class NLL, by method."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figures = []
    for line, methods in result["runs"].items():
        picture, axes = pyplot.subplots(1, 2, figsize=(10.0, 3.6), layout="constrained")
        for side, (name, words) in zip(axes, (("gospa_m", "GOSPA [m]"), ("nll", "class NLL [nats]")), strict=True):
            for place, rows in enumerate(methods.values()):
                values = np.array([row[name] for row in rows])
                spread = np.linspace(-0.25, 0.25, len(values)) if len(values) > 1 else np.zeros(1)
                side.plot(np.maximum(values, 1e-6), place + spread, ".", markersize=5)
            side.set_yticks(range(len(methods)), [WORDS[method] for method in methods])
            side.invert_yaxis()
            side.set_xscale("log" if name == "nll" else "linear")
            side.set_xlabel(words)
            side.grid(axis="x", alpha=0.3)
        axes[1].set_yticklabels([])
        file = out / f"runs_{line}.png"
        picture.savefig(file, dpi=110)
        pyplot.close(picture)
        text = "A dot is a run; smaller is better on both axes. Ghosts and missing objects put GOSPA above 1.4 m."
        figures.append(Figure(f"All runs: {LINES[line]}", text, file))
    return figures
