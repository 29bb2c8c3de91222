"""Tables and pictures of photographs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from semantic_slam.training.latent.views.view_crops import plain_crops
from semantic_slam_lab.studies.ch3.pages import COLUMNS, number
from semantic_slam_lab.studies.ch5.grounding import METHODS as GROUNDING
from semantic_slam_lab.studies.real_turntables.claims import WORDS
from semantic_slam_lab.studies.real_turntables.classification import DrawOutcome
from semantic_slam_lab.studies.real_turntables.lookalikes import Draw, Pair
from semantic_slam_lab.studies.real_turntables.photographs import Photographs
from semantic_slam_lab.studies.result import Figure, Table

METHODS = {
    "ours": "ours: joint process, tracks weighed by their evidence where they are uncertain",
    "recursive": "the thesis's recursion, places taken as exact",
    "model_based": "Model Based",
    "simple_bayes": "Simple Bayes",
}
LATENT = {
    "peak_within_10deg": "peak within 10°, objects that can be told",
    "objects_told": "objects",
    "nees": "NEES",
    "nees_one_view_in_band": "one view by lot in its band",
    "instance_1_view": "instance, 1 view",
    "instance_5_views": "5 views, pose uncertain",
    "new_peak_within_10deg": "new objects: peak",
    "new_nees": "NEES",
    "new_nees_widened": "widened",
    "new_within_two_sigma_widened": "within 2 sigma",
}
SHOWN_DEG = range(0, 360, 40)
SHOWN_PAIRS = 4
CROP = 96


def tables_of(result: Mapping[str, Any]) -> list[Table]:
    """Methods under each uncertainty, pairs, both latent models, objects that nothing tells, grounding."""
    found = [_methods(name, methods) for name, methods in result["classification"].items()]
    pairs = tuple((own["pair"], f"{own['behind']:.3f}", f"{own['front']:.3f}") for own in result["ambiguity"])
    found.append(Table("Look-alikes: entropy of one view [nats]", ("pair", "behind", "in front"), pairs))
    latent = result["latent"]
    rows = tuple((WORDS[name], *(number(own[column]) for column in LATENT)) for name, own in latent.items())
    found.append(Table("Held-out views, latent models", ("model", *LATENT.values()), rows))
    found += [_untold(name, own["objects"]) for name, own in latent.items()]
    if all(own["grounding"] for own in latent.values()):
        tags = tuple(
            (text, *(f"{own['grounding'][key]:.3f}" for own in latent.values())) for key, text in GROUNDING.items()
        )
        found.append(Table("Grounding by two tags: accuracy", ("method", *(WORDS[name] for name in latent)), tags))
    return found


def _methods(name: str, methods: Mapping[str, Any]) -> Table:
    rows = tuple((METHODS[key], *(number(row[column]) for column in COLUMNS)) for key, row in methods.items())
    return Table(f"Classification, {WORDS[name]}", ("method", *COLUMNS.values()), rows)


def _untold(name: str, objects: Mapping[str, Any]) -> Table:
    """Objects whose azimuth a nearest neighbour does not tell."""
    rows = tuple(
        (key, f"{own['nearest_within_10deg']:.2f}", f"{own['peak_within_10deg']:.2f}", f"{own['entropy']:.2f}")
        for key, own in objects.items()
        if not own["can_be_told"]
    )
    told = [own["entropy"] for own in objects.values() if own["can_be_told"]]
    mean = f"{np.mean(told):.2f}" if told else "–"
    title = (
        f"Objects whose azimuth nothing tells, {WORDS[name]} (the others' mean entropy {mean}, flat {np.log(180):.2f})"
    )
    return Table(title, ("object", "nearest neighbour within 10°", "peak within 10°", "entropy [nats]"), rows)


def figures_of(
    out: Path, photographs: Photographs, pairs: Sequence[Pair], draws: Sequence[Draw], found: Sequence[DrawOutcome]
) -> list[Figure]:
    """The most alike pairs, and how unsure single views of them are."""
    text = "The most alike pairs to the trunk, by azimuth from 0°, their front."
    return [
        Figure("Look-alikes", text, _gallery(out / "lookalikes.png", photographs, pairs[:SHOWN_PAIRS])),
        Figure(
            "Which of the two",
            "Entropy over the two, given one view from a known direction; log 2 where nothing tells them apart.",
            _entropies(out / "ambiguity.png", draws, found),
        ),
    ]


def _gallery(file: Path, photographs: Photographs, pairs: Sequence[Pair]) -> Path:
    names = [name for pair in pairs for name in pair.names]
    canvas = Canvas(figsize=(len(SHOWN_DEG), len(names)), layout="constrained")
    for row, axes in zip(names, canvas.subplots(len(names), len(SHOWN_DEG), squeeze=False), strict=True):
        views = photographs.of(row)
        for angle, axis in zip(SHOWN_DEG, axes, strict=True):
            away = np.abs(np.angle(np.exp(1j * (photographs.azimuth_rad[views] - np.deg2rad(angle)))))
            axis.imshow(plain_crops([photographs.views[views[away.argmin()]]], CROP)[0])
            axis.set_axis_off()
    canvas.savefig(file, dpi=80)
    return file


def _entropies(file: Path, draws: Sequence[Draw], found: Sequence[DrawOutcome]) -> Path:
    canvas = Canvas(figsize=(9, 4), layout="constrained")
    axis = canvas.subplots()
    shown: set[tuple[str, ...]] = set()
    for draw, own in zip(draws, found, strict=True):
        if draw.names[:2] in shown or len(shown) == SHOWN_PAIRS:
            continue
        shown.add(draw.names[:2])
        order = np.argsort(own.pair_azimuth_rad)
        degrees = np.rad2deg(own.pair_azimuth_rad[order])
        axis.plot(degrees, own.pair_entropy[order], ".", markersize=4, label=" / ".join(draw.names[:2]))
    axis.axvspan(-80, 80, alpha=0.1, color="grey")
    axis.set(xlabel="azimuth [°]; grey: what the network was trained on", ylabel="entropy [nats]", xlim=(-180, 180))
    axis.legend(fontsize="small")
    canvas.savefig(file, dpi=100)
    return file
