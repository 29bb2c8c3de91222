"""Tables, claims and the picture of the curves."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure as Canvas

from semantic_slam_lab.studies.novelty.curves import KNOWN, METHODS, NEAREST, OURS, RATES, STATED, UNKNOWN
from semantic_slam_lab.studies.novelty.features import ALONE, IMAGENET, ROOMS, SHIPPED
from semantic_slam_lab.studies.result import Claim, Figure, Table, required

TRUNKS = {SHIPPED: "the shipped network", IMAGENET: "an ImageNet network"}
SETTINGS = {ALONE: "objects alone", ROOMS: "objects in random rooms"}
GROUPS = {UNKNOWN: "photographs of unknown objects", "noise": "pictures of noise", "blocks": "coloured blocks"}
LEAST = {UNKNOWN: 0.8, "noise": 0.99, "blocks": 0.99}
"""Share of a group to be called unknown at :data:`STATED` false alarms."""
MOST_FALSE = 2.0
"""Largest false alarms on new views, relative to those that are stated."""


def claims_of(networks: Mapping[str, Any]) -> list[Claim]:
    """What is called unknown at 5 % false alarms, and whether these are the stated ones."""
    at = RATES.index(STATED)
    claims = []
    for where, methods in _parts(networks):
        ours = methods[OURS]["curve"]
        for group, least in LEAST.items():
            share = ours["realised"][group][at]
            text = f"{where}: {GROUPS[group]} called unknown for ≥ {least:.0%} at {STATED:.0%} false alarms"
            claims.append(required(text, f"{share:.3f}", share >= least))
        false = ours["stated"][KNOWN][at]
        text = f"{where}: false alarms between fitted directions at most {MOST_FALSE:.0f} times the stated"
        claims.append(required(text, f"{false:.3f} for {STATED:.2f}", false <= MOST_FALSE * STATED))
    return claims


def tables_of(networks: Mapping[str, Any]) -> list[Table]:
    """The curves, a table for each network and setting."""
    columns = ("method", "pictures", "area", *(f"{rate:.0%}" for rate in RATES))
    found = []
    for where, methods in _parts(networks):
        rows = [
            (METHODS[method], GROUPS[group], f"{own['area'][group]:.3f}", *_cells(own["curve"]["realised"][group]))
            for method, own in methods.items()
            for group in GROUPS
        ]
        found.append(Table(f"Called unknown, by false alarms: {where}", columns, tuple(rows)))
        stated = [(METHODS[method], *_cells(own["curve"]["stated"][KNOWN])) for method, own in methods.items()]
        title = f"False alarms between fitted directions, by those stated: {where}"
        found.append(Table(title, ("method", *columns[3:]), tuple(stated)))
    return found


def _parts(networks: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Network and setting in words, with the methods."""
    return [
        (f"{TRUNKS[name]}, {SETTINGS[setting]}", methods)
        for name, settings in networks.items()
        for setting, methods in settings.items()
    ]


def _cells(shares: list[float]) -> tuple[str, ...]:
    return tuple(f"{share:.3f}" for share in shares)


def figure_of(file: Path, networks: Mapping[str, Any]) -> Figure:
    """False alarms against what is found; a panel for each network and setting."""
    parts = _parts(networks)
    rows = len(networks)
    canvas = Canvas(figsize=(5 * len(parts) / rows, 3.5 * rows), layout="constrained")
    panels = canvas.subplots(rows, len(parts) // rows, squeeze=False, sharex=True, sharey=True)
    for axis, (where, methods) in zip(panels.flat, parts, strict=True):
        for group, colour in zip(GROUPS, ("C0", "C1", "C2"), strict=True):
            for method, style in ((OURS, "o-"), (NEAREST, "x:")):
                shares = methods[method]["curve"]["realised"][group]
                label = GROUPS[group] if method == OURS else None
                axis.plot(RATES, shares, style, color=colour, label=label)
        axis.axvline(STATED, color="grey", linewidth=0.8)
        axis.set(xscale="log", title=where, ylim=(-0.02, 1.02))
        axis.set_xticks(RATES, [f"{rate:.0%}" for rate in RATES])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    canvas.supxlabel("false alarms: share of known objects' new views called unknown")
    canvas.supylabel("share called unknown")
    panels[0, 0].legend(fontsize="small", loc="lower right")
    canvas.savefig(file, dpi=100)
    text = "Solid: ours. Dotted: cosine to the nearest fitted view. Means over draws of known objects."
    return Figure("Novelty as a curve", text, file)
