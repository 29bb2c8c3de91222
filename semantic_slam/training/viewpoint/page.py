"""The page of fitted viewpoint models: coverage, fit, residuals and calibration of every class."""

import base64
import html
import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.viewpoint.fit import FittedModels
from semantic_slam.training.viewpoint.samples import ClassSamples
from semantic_slam.viewpoint.gaussian_process import GRID, even_azimuths
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.store import FittedModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLE = (
    "body{font:16px system-ui,sans-serif;margin:2rem auto;max-width:70rem;padding:0 1rem;color:#1a2330}"
    "img{width:100%;height:auto}table{border-collapse:collapse}td,th{padding:.3rem .9rem .3rem 0;text-align:left}"
    ".wide{overflow-x:auto}"
)


def write_page(path: Path, fitted: FittedModels, samples: Mapping[str, ClassSamples]) -> None:
    """Self-contained HTML; names are escaped."""
    model, report = fitted.model, fitted.report
    sections = [
        f"<h2>{html.escape(name)}</h2>{_table(report[name], model.num_features)}"
        f'<img alt="{html.escape(name)}: coverage, fit, residuals" src="{_picture(fitted, name, samples[name])}">'
        for name in model.class_names
    ]
    text = (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>Viewpoint models</title><style>{STYLE}</style><h1>Viewpoint models</h1>"
        f"<p>{len(model.class_names)} classes, scores {html.escape(', '.join(model.feature_names))}. Residuals are of"
        " views left out of the fit, in standard deviations: 68 % should lie within 1 and 95 % within 2.</p>"
        f"{''.join(sections)}</html>\n"
    )
    path.write_text(text, encoding="utf-8")


def _table(numbers: Mapping[str, Any], num_features: int) -> str:
    rows = {
        "views": f"{numbers['coverage']['views']:.0f}",
        "widest gap": f"{numbers['coverage']['widest_gap_deg']:.0f} deg",
        "left out in turn": numbers["left_out"],
        "within 1 / 2 sigma": f"{numbers['fraction_within_1_sigma']:.2f} / {numbers['fraction_within_2_sigma']:.2f}",
        "squared whitened residual": f"{numbers['mean_squared_whitened_residual']:.2f} of {num_features}",
        "NLL": f"{numbers['nll']:.2f} nats",
    }
    head = "".join(f"<th>{name}" for name in rows)
    return f'<div class="wide"><table><tr>{head}<tr>{"".join(f"<td>{value}" for value in rows.values())}</table></div>'


def _picture(fitted: FittedModels, name: str, samples: ClassSamples) -> str:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7), layout="constrained")
    grid = figure.add_gridspec(2, 3)
    _coverage(figure.add_subplot(grid[0, 0], projection="polar"), samples.azimuth_rad)
    _fit(figure.add_subplot(grid[0, 1:]), fitted.model, name, samples)
    standardised = fitted.left_out[name].standardised
    _residuals(figure.add_subplot(grid[1, 1:]), samples, standardised)
    _calibration(figure.add_subplot(grid[1, 0]), standardised)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _coverage(axes: "Axes", azimuth_rad: Array) -> None:
    axes.plot(azimuth_rad, np.ones(len(azimuth_rad)), "o", markersize=3, color="#0072b2")
    axes.set_yticks([])
    axes.set_ylim(0.0, 1.15)
    axes.set_title("directions with views")


def _fit(axes: "Axes", model: FittedModel, name: str, samples: ClassSamples) -> None:
    azimuth = even_azimuths(GRID)
    height = 0.0 if samples.elevation_rad is None else float(np.median(samples.elevation_rad))
    viewpoints = Viewpoints(azimuth, np.full(GRID, height), np.ones(GRID))
    prediction = model.predict(np.full(GRID, model.class_names.index(name)), viewpoints)
    degrees, seen = np.rad2deg(azimuth), np.rad2deg(samples.azimuth_rad % (2.0 * np.pi))
    for index, feature in enumerate(model.feature_names):
        (line,) = axes.plot(degrees, prediction.mean[:, index], label=feature)
        sigma = np.sqrt(prediction.covariance[:, index, index])
        low, high = prediction.mean[:, index] - 2.0 * sigma, prediction.mean[:, index] + 2.0 * sigma
        axes.fill_between(degrees, low, high, alpha=0.15, color=line.get_color())
        axes.plot(seen, samples.features[:, :, index].mean(axis=1), ".", markersize=3, color=line.get_color())
    axes.set(title=f"mean scores, model with 2 sigma{_from_height(samples)}", xlabel="azimuth [deg]", xlim=(0, 360))
    axes.legend(fontsize="small", ncols=3)


def _from_height(samples: ClassSamples) -> str:
    if samples.elevation_rad is None:
        return ""
    return f", from {np.rad2deg(np.median(samples.elevation_rad)):.0f} deg above"


def _residuals(axes: "Axes", samples: ClassSamples, standardised: Array) -> None:
    order = np.argsort(samples.folds, kind="stable")
    repeats = samples.features.shape[1]
    azimuth = np.repeat(np.rad2deg(samples.azimuth_rad[order] % (2.0 * np.pi)), repeats)
    axes.plot(azimuth, standardised, ".", markersize=3, alpha=0.5)
    axes.axhspan(-2.0, 2.0, alpha=0.1, color="grey")
    axes.set(title="views left out", xlabel="azimuth [deg]", ylabel="residual [sigma]", xlim=(0, 360), ylim=(-6, 6))


def _calibration(axes: "Axes", standardised: Array) -> None:
    from scipy.stats import norm

    nominal = np.linspace(0.02, 0.98, 49)
    inside = [np.mean(np.abs(standardised) <= norm.ppf(0.5 + 0.5 * level)) for level in nominal]
    axes.plot([0, 1], [0, 1], color="grey", linewidth=1)
    axes.plot(nominal, inside, color="#0072b2")
    axes.set(title="reliability", xlabel="stated share of residuals inside", ylabel="measured", aspect="equal")
