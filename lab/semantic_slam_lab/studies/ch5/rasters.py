"""Rasters of the learned log-likelihood over pairs of axes about a true view (Figs. 5.3, 5.7, 5.8)."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.viewpoint.model import Viewpoints

STEPS = 61
SHOWN_NATS = 60.0
"""Below the largest value of a panel everything has one colour."""


@dataclass(frozen=True)
class Panel:
    """Two axes, and the viewpoints and descriptors at (P,) offsets along them."""

    labels: tuple[str, str]
    reach: tuple[float, float]
    at: Callable[[Array, Array], tuple[Viewpoints, Array]]


def raster_figure(file: Path, model: LatentModel, view: FeatureViews, descriptor: Array) -> Path:
    """PNG of panels about one view, (1,) of ``view``, with its true (L,) ``descriptor``."""
    panels = [*_pose_panels(view.viewpoints, descriptor), *_descriptor_panels(model, view.viewpoints, descriptor)]
    canvas = Canvas(figsize=(13, 7.6), layout="constrained")
    for axis, panel in zip(canvas.subplots(2, 3).flat, panels, strict=True):
        values, first, second = _raster(model, view.features[0], panel)
        shown = np.maximum(values, values.max() - SHOWN_NATS)
        image = axis.pcolormesh(first, second, shown.T, cmap="viridis", shading="nearest")
        best = np.unravel_index(values.argmax(), values.shape)
        axis.plot(0.0, 0.0, "o", markerfacecolor="none", markeredgecolor="white", markersize=10)
        axis.plot(first[best[0]], second[best[1]], "x", color="#ff5a36", markersize=9, markeredgewidth=2.2)
        axis.set(xlabel=panel.labels[0], ylabel=panel.labels[1])
        canvas.colorbar(image, ax=axis, label="log-likelihood [nats]")
    canvas.savefig(file, dpi=105)
    return file


def _raster(model: LatentModel, feature: Array, panel: Panel) -> tuple[Array, Array, Array]:
    """(STEPS, STEPS) values and the offsets along both axes."""
    first, second = (reach * np.linspace(-1.0, 1.0, STEPS) for reach in panel.reach)
    grid = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    viewpoints, descriptors = panel.at(grid[:, 0], grid[:, 1])
    residual = (feature - model.mean(viewpoints, descriptors)) / model.noise.tempered
    return -0.5 * (residual**2).sum(axis=1).reshape(STEPS, STEPS), first, second


def _pose_panels(view: Viewpoints, descriptor: Array) -> list[Panel]:
    azimuth, elevation, range_m = view.azimuth_rad[0], view.elevation_rad[0], view.range_m[0]

    def moved(x: Array, y: Array) -> tuple[Viewpoints, Array]:
        """The camera shifted in the plane: x outwards, y to the left of who looks outwards."""
        flat = range_m * np.cos(elevation)
        outwards, aside = flat + x, y
        turn = azimuth + np.arctan2(aside, outwards)
        height = np.full_like(x, range_m * np.sin(elevation))
        distance = np.hypot(outwards, aside)
        return _viewpoints(turn, np.arctan2(height, distance), np.hypot(distance, height)), _tiled(descriptor, x)

    def turned(by: Array, up: Array) -> tuple[Viewpoints, Array]:
        turn, lift = azimuth + np.deg2rad(by), elevation + np.deg2rad(up)
        return _viewpoints(turn, lift, np.full_like(by, range_m)), _tiled(descriptor, by)

    return [
        Panel(("camera away from the object [m]", "camera aside [m]"), (1.0, 1.5), moved),
        Panel(("azimuth off [°]", "elevation off [°]"), (60.0, 12.0), turned),
        Panel(("azimuth off, all around [°]", "elevation off [°]"), (180.0, 12.0), turned),
    ]


def _descriptor_panels(model: LatentModel, view: Viewpoints, descriptor: Array) -> list[Panel]:
    """Pairs of the first six axes, three of the prior's sigmas either way."""
    sigma = model.prior.sigma[0]

    def panel(first: int) -> Panel:
        def shifted(a: Array, b: Array) -> tuple[Viewpoints, Array]:
            descriptors = _tiled(descriptor, a)
            descriptors[:, first] += a * sigma[first]
            descriptors[:, first + 1] += b * sigma[first + 1]
            count = len(a)
            repeated = _viewpoints(*(np.repeat(value, count) for value in vars(view).values()))
            return repeated, descriptors

        return Panel((f"descriptor {first + 1} [prior σ]", f"descriptor {first + 2} [prior σ]"), (3.0, 3.0), shifted)

    return [panel(first) for first in (0, 2, 4)]


def _viewpoints(azimuth: Array, elevation: Array, range_m: Array) -> Viewpoints:
    return Viewpoints(azimuth, elevation, range_m)


def _tiled(descriptor: Array, like: Array) -> Array:
    return np.tile(descriptor, (len(like), 1))
