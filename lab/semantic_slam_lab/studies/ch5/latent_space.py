"""The latent space (Figs. 5.1a, 5.4): encoded views by instance, and what the model expects to see from where."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.offsetbox import AnnotationBbox, OffsetImage
from numpy.typing import NDArray
from sklearn.linear_model import Ridge
from sklearn.manifold import TSNE
from sklearn.metrics import silhouette_score

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.training.latent.views.view_crops import plain_crops
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.simulation.goods import goods_class
from semantic_slam_lab.studies.ch5.models import DEFAULT, FORMULATIONS, WORDS, chosen_goods, known, trained
from semantic_slam_lab.studies.ch5.pages import framed, numbers_table
from semantic_slam_lab.studies.ch5.views import measured, validation_views
from semantic_slam_lab.studies.result import Claim, Figure, write_result

NAME = "ch5_latent_space"
QUICK_INSTANCES = 8
SIZE = 32
"""Pixels of the pictures that predicted features are shown as."""
GRID_DEG = np.arange(0.0, 360.0, 30.0)
SHOWN_INSTANCES, RANDOM_DESCRIPTORS = 5, 5


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, encode, draw; returns the files written."""
    out.mkdir(parents=True, exist_ok=True)
    names = chosen_goods(QUICK_INSTANCES if quick else None)
    views = validation_views(names, jobs)
    pictures = plain_crops(views, SIZE)
    numbers, figures = {}, []
    for name in (*FORMULATIONS, DEFAULT):
        model = trained(name)
        seen = measured(model, views, model.crops, seed)
        encoded = model.model.encode(seen.features).mean / model.model.prior.sigma
        numbers[name] = evaluated(model.model, seen, encoded)
        figures.append(_space(out / f"space_{name}.png", name, seen, encoded, pictures, seed))
        shown = known(model, names)
        figures.append(_predictions(out / f"predictions_{name}.png", name, model.model, seen, pictures, shown, seed))
    config = {"instances": len(names), "views": len(views)}
    result = framed(NAME, numbers, config, quick=quick, seed=seed)
    return write_result(out, result, claims(numbers), [numbers_table("Encoded unseen views", numbers)], figures)


def evaluated(model: LatentModel, views: FeatureViews, encoded: Array) -> dict[str, float]:
    """How well views of one instance lie together; ``encoded`` (N, L) in sigmas of the prior."""
    classes = np.array([goods_class(name) for name in views.names])[views.instance]
    neighbour = _nearest_other(encoded)
    spread = np.array([encoded[views.instance == index].std(axis=0) for index in range(len(views.names))])
    return {
        "silhouette_by_instance": float(silhouette_score(encoded, views.instance)),
        "nearest_view_same_instance": float((views.instance[neighbour] == views.instance).mean()),
        "nearest_view_same_class": float((classes[neighbour] == classes).mean()),
        "spread_within_instance": float(np.sqrt((spread**2).mean())),
        "dimensions": float(model.num_dimensions),
    }


def _nearest_other(points: Array) -> NDArray[np.int_]:
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(distance, np.inf)
    return np.asarray(distance.argmin(axis=1))


def claims(numbers: dict[str, dict[str, float]]) -> list[Claim]:
    """What Figs. 5.1a and 5.4 are said to show."""
    told = ", ".join(f"{WORDS[n]} {m['nearest_view_same_instance']:.2f}" for n, m in numbers.items())
    classes = ", ".join(f"{WORDS[n]} {m['nearest_view_same_class']:.2f}" for n, m in numbers.items())
    return [
        Claim(
            "All viewpoints of an object are encoded close to each other: the nearest view is of the same instance",
            "Fig. 5.1a",
            "well-localised clusters, one per object",
            told,
            min(row["nearest_view_same_instance"] for row in numbers.values()) > 0.9,
        ),
        Claim(
            "Objects of like appearance, here of one class, lie together without any class label",
            "Sec. 5.6.A",
            "expected in an ideal case",
            classes,
            min(row["nearest_view_same_class"] for row in numbers.values()) > 0.9,
        ),
    ]


def _space(file: Path, formulation: str, views: FeatureViews, encoded: Array, pictures: Bytes, seed: int) -> Figure:
    """PNG of a t-SNE embedding: points by instance, and the pictures behind some of them."""
    perplexity = min(30.0, (len(encoded) - 1) / 3.0)
    flat = TSNE(perplexity=perplexity, init="pca", random_state=seed).fit_transform(encoded)
    canvas = Canvas(figsize=(14, 7), layout="constrained")
    left, right = canvas.subplots(1, 2)
    colours = colormaps["turbo"](np.linspace(0.0, 1.0, len(views.names)))
    for index in keyed_generator(NAME, "order", seed).permutation(len(views.names)):
        own = views.instance == index
        left.plot(*flat[own].T, ".", color=colours[index], markersize=4)
    for row in _spread_out(flat, 120):
        box = OffsetImage(pictures[row], zoom=0.75)
        right.add_artist(AnnotationBbox(box, flat[row], frameon=False))
    right.set(xlim=left.get_xlim(), ylim=left.get_ylim())
    for axis in (left, right):
        axis.set(xticks=[], yticks=[])
    canvas.savefig(file, dpi=100)
    text = (
        "t-SNE of the encoder's descriptors of unseen views, a colour for each instance, and pictures of some of them."
    )
    return Figure(f"Latent space, {WORDS[formulation]}", text, file)


def _spread_out(points: Array, count: int) -> list[int]:
    """Rows far from each other, one after the other the farthest from those taken."""
    chosen = [0]
    distance = np.linalg.norm(points - points[0], axis=1)
    for _ in range(min(count, len(points)) - 1):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen


def _predictions(
    file: Path,
    formulation: str,
    model: LatentModel,
    views: FeatureViews,
    pictures: Bytes,
    known: tuple[str, ...],
    seed: int,
) -> Figure:
    """PNG: predicted features as pictures, by a linear read-out fitted to the views, around objects and descriptors."""
    readout = Ridge(alpha=1.0).fit(views.features, pictures.reshape(len(pictures), -1).astype(np.float64))
    chosen = known[:: max(len(known) // SHOWN_INSTANCES, 1)][:SHOWN_INSTANCES]
    descriptors = [model.instances.descriptors[model.instances.names.index(name)] for name in chosen]
    generator = keyed_generator(NAME, "random descriptors", seed)
    drawn = model.prior.mean + model.prior.sigma * generator.standard_normal((RANDOM_DESCRIPTORS, model.num_dimensions))
    elevation = float(np.median(views.viewpoints.elevation_rad))
    canvas = Canvas(figsize=(14, 8.6), layout="constrained")
    axes = canvas.subplots(2 * len(chosen) + RANDOM_DESCRIPTORS, len(GRID_DEG))
    for row, (name, descriptor) in enumerate(zip(chosen, descriptors, strict=True)):
        _show(axes[2 * row], _nearest_pictures(views, pictures, name), "seen" if row == 0 else "")
        _show(axes[2 * row + 1], _read(readout, model, descriptor, elevation), "predicted" if row == 0 else "")
    for row, descriptor in enumerate(drawn, start=2 * len(chosen)):
        _show(axes[row], _read(readout, model, descriptor, elevation), "random" if row == 2 * len(chosen) else "")
    canvas.savefig(file, dpi=90)
    text = (
        "Seen views and predicted means all around some objects (columns: every 30° of azimuth), then the same for"
        " random descriptors. Features are turned into pictures by a linear fit, made for this figure alone."
    )
    return Figure(f"Predicted means, {WORDS[formulation]}", text, file)


def _read(readout: Ridge, model: LatentModel, descriptor: Array, elevation: float) -> Bytes:
    count = len(GRID_DEG)
    viewpoints = Viewpoints(np.deg2rad(GRID_DEG), np.full(count, elevation), np.ones(count))
    flat = readout.predict(model.mean(viewpoints, np.tile(descriptor, (count, 1))))
    return np.asarray(np.clip(flat, 0, 255), dtype=np.uint8).reshape(count, SIZE, SIZE, 3)


def _nearest_pictures(views: FeatureViews, pictures: Bytes, name: str) -> Bytes:
    rows = np.flatnonzero(views.instance == views.names.index(name))
    azimuth = views.viewpoints.azimuth_rad[rows]
    nearest = [rows[np.cos(azimuth - angle).argmax()] for angle in np.deg2rad(GRID_DEG)]
    return pictures[nearest]


def _show(axes: Sequence[Axes], pictures: Bytes, label: str) -> None:
    for axis, picture in zip(axes, pictures, strict=True):
        axis.imshow(picture)
        axis.set(xticks=[], yticks=[])
        for spine in axis.spines.values():
            spine.set_visible(False)
    axes[0].set_ylabel(label, fontsize=8)
