"""Claims, tables and figures of the study of drawn worlds."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kstwo, norm

from semantic_slam_lab.studies.drawn_worlds.calibration import LEVEL
from semantic_slam_lab.studies.drawn_worlds.truths import RIGHT, WITHIN_PRIOR
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Figure, Table, required

STATED, LEAST_HELD = 0.95, 0.9
SIGMAS = float(norm.isf(LEVEL / 2.0))


def claims_of(result: dict[str, Any]) -> list[Claim]:
    """That ranks are even, probabilities right, and regions hold as often as stated, and nearly so otherwise."""
    uneven = result["rejected"]
    bins = [row for rows in result["reliability"].values() for row in rows]
    return [
        Claim(
            "Ranks of the truth are even (Holm, 1 %)", REQUIREMENT, "", ", ".join(uneven) or "none uneven", not uneven
        ),
        Claim(
            "What is stated with a probability holds so often (all bins, 1 %)",
            REQUIREMENT,
            "",
            f"{sum(not row[3] for row in bins)} of {len(bins)} bins off",
            all(row[3] for row in bins),
        ),
        _right(result["region95_held"][RIGHT], result["region95_held_sigma"][RIGHT]),
        _others(result["region95_held"]),
    ]


def _right(held: float, sigma: float) -> Claim:
    """``sigma``: standard error of ``held``, as worlds scatter; keyframes of one world do not err independently."""
    text = f"As stated, {STATED:.0%} regions hold the truth in {STATED:.0%} (within {SIGMAS:.1f} standard errors)"
    return required(text, f"{held:.1%} ± {sigma:.1%}", abs(held - STATED) <= SIGMAS * sigma)


def _others(held: dict[str, float]) -> Claim:
    """One thing apart at a time, within the prior or not."""
    shares = {truth: share for truth, share in held.items() if truth != RIGHT}
    told = ", ".join(f"{_named(truth)} {share:.0%}" for truth, share in shares.items())
    text = f"With one thing apart at a time, {STATED:.0%} regions hold the truth in at least {LEAST_HELD:.0%}"
    return required(text, told, min(shares.values()) >= LEAST_HELD)


def _named(truth: str) -> str:
    return f"{truth} (within the prior)" if truth in WITHIN_PRIOR else truth


def tables_of(result: dict[str, Any]) -> list[Table]:
    """Ranks, stated probabilities, regions."""
    ranks = [
        (name, str(len(result["ranks"][name])), f"{value:.3g}", "no" if name in result["rejected"] else "yes")
        for name, value in result["p_values"].items()
    ]
    bins = [
        (name, f"{mean:.2f}", f"{share:.2f}", str(count), "yes" if credible else "no")
        for name, rows in result["reliability"].items()
        for mean, share, count, credible in rows
    ]
    regions = [
        (_named(truth), str(result["num_worlds"][truth]), f"{share:.1%}")
        for truth, share in result["region95_held"].items()
    ]
    return [
        Table("Ranks of the truth in what the belief says", ("quantity", "worlds", "p", "even"), tuple(ranks)),
        Table("Stated and observed", ("what", "stated", "observed", "worlds", "credible"), tuple(bins)),
        Table("Keyframes whose 95 % region holds the position", ("worlds drawn", "number", "held"), tuple(regions)),
    ]


def figures_of(out: Path, result: dict[str, Any]) -> list[Figure]:
    """The empirical distribution of each rank, less what is even, inside the simultaneous band."""
    from cycler import cycler
    from matplotlib import rcParams
    from matplotlib.figure import Figure as Picture

    picture = Picture(figsize=(8.0, 4.5), layout="constrained")
    axes = picture.subplots()
    axes.set_prop_cycle(cycler(linestyle=["-", "--"]) * rcParams["axes.prop_cycle"])
    for name, values in result["ranks"].items():
        ordered = np.sort(values)
        axes.plot(ordered, (np.arange(len(ordered)) + 0.5) / len(ordered) - ordered, label=name, linewidth=1.2)
    band = float(kstwo.isf(LEVEL, min(len(values) for values in result["ranks"].values())))
    axes.fill_between([0.0, 1.0], -band, band, color="0.9", zorder=0, label="99 % band")
    axes.set(xlabel="rank of the truth", ylabel="empirical distribution, less the even one", xlim=(0.0, 1.0))
    axes.legend(fontsize=7, ncols=2)
    file = out / "ranks.png"
    picture.savefig(file, dpi=130)
    text = "A curve above the band on the left and below it on the right belongs to a belief that is too sure."
    return [Figure("Ranks of the truth", text, file)]
