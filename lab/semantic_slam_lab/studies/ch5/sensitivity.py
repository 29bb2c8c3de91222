"""How far off ascent of the learned likelihood may start (Fig. 5.6): direction of view, and descriptor."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.judging import evaluation
from semantic_slam.training.latent.judging.estimation import ascend_descriptors
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.ch5.models import DEFAULT, FORMULATIONS, WORDS, chosen_goods, known, trained
from semantic_slam_lab.studies.ch5.pages import framed, numbers_table
from semantic_slam_lab.studies.ch5.views import measured, named, validation_views
from semantic_slam_lab.studies.result import Claim, Figure, write_result

NAME = "ch5_sensitivity"
QUICK_INSTANCES = 16
OFFSET_DEG = {"map": 18.0, "energy": 25.0, "default": 18.0}
"""Where the project's aims start the ascent of each formulation."""
LARGEST_DEG = 90.0
SHOWN_DEG = 0.05
"""Smaller errors are drawn at the lower edge."""
DESCRIPTOR_OFFSETS = (0.5, 1.0, 2.0)
"""Root mean square over the descriptor's axes, in sigmas of its prior."""


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, ascend, draw; returns the files written."""
    out.mkdir(parents=True, exist_ok=True)
    names = chosen_goods(QUICK_INSTANCES if quick else None)
    views = validation_views(names, jobs)
    numbers, scatters = {}, {}
    for name in (*FORMULATIONS, DEFAULT):
        model = trained(name)
        seen = named(measured(model, views, model.crops, seed), known(model, names))
        numbers[name], scatters[name] = evaluated(model.model, seen, OFFSET_DEG[name], seed)
    config = {"instances": len(names), "views": len(views), "offset_deg": OFFSET_DEG}
    result = framed(NAME, numbers, config, quick=quick, seed=seed)
    figure = Figure(
        "Ascent over the azimuth",
        "Error after the ascent against the error it started with, a point for each unseen view; below the line the"
        " ascent helped. Bands along multiples of 90° are sides that look alike.",
        _scatter(out / "ascents.png", scatters),
    )
    return write_result(out, result, claims(numbers), [numbers_table("Ascents", numbers)], [figure])


def evaluated(
    model: LatentModel, views: FeatureViews, offset_deg: float, seed: int
) -> tuple[dict[str, float], evaluation.Ascents]:
    """Numbers of a model, and ascents from starts all over for the picture."""
    own = evaluation.own_descriptors(model, views)
    fixed = evaluation.gradient_ascent(model, views, own, np.deg2rad(offset_deg), keyed_generator(NAME, "at", seed))
    wide = evaluation.local_ascent(model, views, own, np.deg2rad(LARGEST_DEG), keyed_generator(NAME, "wide", seed))
    numbers = {
        "start_deg": offset_deg,
        "improved_fraction": fixed.improved_fraction,
        "median_error_deg": fixed.median_error_deg,
        "improved_fraction_up_to_90deg": wide.improved_fraction,
    }
    for size in DESCRIPTOR_OFFSETS:
        numbers[f"descriptor_improved_from_{size:g}_sigma"] = _descriptors_improved(model, views, own, size, seed)
    return numbers, wide


def _descriptors_improved(model: LatentModel, views: FeatureViews, own: Array, size: float, seed: int) -> float:
    """Share of views from which alone, their direction known, the descriptor moves towards the learned one."""
    sigma = model.prior.sigma
    offsets = size * keyed_generator(NAME, "descriptor", seed, str(size)).standard_normal(own.shape)
    ends = ascend_descriptors(model, views.viewpoints, views.features[:, None], own + offsets * sigma)
    after = np.linalg.norm((ends.mean - own) / sigma, axis=1)
    return float((after < np.linalg.norm(offsets, axis=1)).mean())


def claims(numbers: dict[str, dict[str, float]]) -> list[Claim]:
    """The project's aims, and what the thesis says of the descriptor."""
    of_map, of_energy = numbers["map"], numbers["energy"]
    return [
        Claim(
            "MAP: ascent from 18° off improves 90 % of the views",
            "project",
            "most points lie below the diagonal (Fig. 5.6b)",
            f"{of_map['improved_fraction']:.3f}, median {of_map['median_error_deg']:.2f}°",
            of_map["improved_fraction"] >= 0.9,
        ),
        Claim(
            "Energy: ascent from 25° off improves 95 %, to a median of 2.5°",
            "project",
            "",
            f"{of_energy['improved_fraction']:.3f}, median {of_energy['median_error_deg']:.2f}°",
            of_energy["improved_fraction"] >= 0.95 and of_energy["median_error_deg"] <= 2.5,
        ),
        Claim(
            "The descriptor, started 1 sigma off, moves towards the learned one from a single view in most views",
            "Sec. 5.D.1",
            "unstable, like the orientation",
            ", ".join(f"{WORDS[name]} {row['descriptor_improved_from_1_sigma']:.2f}" for name, row in numbers.items()),
            min(row["descriptor_improved_from_1_sigma"] for row in numbers.values()) > 0.5,
        ),
    ]


def _scatter(file: Path, scatters: dict[str, evaluation.Ascents]) -> Path:
    canvas = Canvas(figsize=(14, 5.2), layout="constrained")
    equal = np.geomspace(SHOWN_DEG, LARGEST_DEG, 100)  # a curve on axes of which one is logarithmic
    for axis, (name, found) in zip(canvas.subplots(1, len(scatters), sharey=True), scatters.items(), strict=True):
        start, end = (np.rad2deg(np.abs(values)) for values in (found.start_rad, found.end_rad))
        axis.plot(equal, equal, color="#999999", linewidth=1.0)
        axis.plot(start, np.maximum(end, SHOWN_DEG), ".", color="#1f5fae", markersize=4, alpha=0.5)
        axis.set(
            title=WORDS[name],
            xlabel="azimuth error at the start [°]",
            ylabel="after [°]",
            yscale="log",
            ylim=(SHOWN_DEG, 200),
        )
        axis.grid(alpha=0.25)
    canvas.savefig(file, dpi=110)
    return file
