"""The objects' descriptors in a learned latent space: one strip of colours each, and a map of their two main axes."""

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from semantic_slam.geometry.arrays import Array
from semantic_slam.report.document import Analysis
from semantic_slam.report.drawing.palette import OTHER_COLOUR, class_colours
from semantic_slam.report.shown.objects import object_label

ROW, LABEL, WIDTH = 22, 132, 520
LOW, HIGH = np.array([0, 114, 178]), np.array([213, 94, 0])
"""Colours of a component far below and far above the average of the objects."""
MAP_SIZE, MAP_MARGIN = 420, 46


@dataclass(frozen=True)
class DescriptorFigures:
    """Figures of the last belief's descriptors: strips by component, and the plane of their largest variance."""

    strips: Markup
    plane: Markup | None  # None with fewer than three objects
    share: float  # of the descriptors' variance that the plane shows
    classes: list[tuple[str, str]]  # name and colour, of the true classes where they are known


def descriptor_figures(analysis: Analysis) -> DescriptorFigures | None:
    """Descriptor figures of the last belief; None for a run without descriptors."""
    last = analysis.record.beliefs[-1]
    has_one = np.asarray(np.isfinite(last.descriptors).all(axis=1))
    seen = [row for row, n in enumerate(last.object_ids) if analysis.detection_counts[int(n)] and has_one[row]]
    if not last.descriptors.shape[1] or not seen:
        return None
    mean, sigma = last.descriptors[seen], np.sqrt(last.descriptor_covariances[seen])
    labels = [object_label(last, row) for row in seen]
    names = _classes(analysis, seen)
    known = sorted({name for name in names if name})
    colours = dict(zip(known, class_colours(len(known)), strict=True))
    titles = [f"{label} {name}".strip() for label, name in zip(labels, names, strict=True)]
    plane, share = None, 0.0
    if len(seen) > 2 and mean.shape[1] > 1:
        axes, share = main_axes(mean)
        fills = [colours.get(name, OTHER_COLOUR) for name in names]
        plane = plane_svg(mean @ axes, _projected(sigma, axes), [str(last.object_ids[row]) for row in seen], fills)
    return DescriptorFigures(strips_svg(mean, sigma, titles), plane, share, list(colours.items()))


def _classes(analysis: Analysis, rows: list[int]) -> list[str]:
    """True classes where they are known, else the likeliest ones of a grounded space, else nothing."""
    last, evaluation = analysis.record.beliefs[-1], analysis.evaluation
    true = evaluation.true_classes if evaluation else {}
    names = []
    for row in rows:
        name = true.get(int(last.object_ids[row]), "")
        if not name and last.class_names:
            name = last.class_names[int(np.argmax(last.class_probabilities[row]))]
        names.append(name)
    return names


def main_axes(mean: Array) -> tuple[Array, float]:
    """(L, 2) axes along which (O, L) descriptors differ most, and the share of their variance along these."""
    centred = mean - mean.mean(axis=0)
    _, scale, directions = np.linalg.svd(centred, full_matrices=False)
    axes = directions[:2].T * np.where(directions[:2].sum(axis=1) < 0.0, -1.0, 1.0)
    return axes, float((scale[:2] ** 2).sum() / max((scale**2).sum(), 1e-300))


def _projected(sigma: Array, axes: Array) -> Array:
    """(O, 2, 2) covariances in the plane of (O, L) standard deviations."""
    return np.asarray(np.einsum("lp,ol,lq->opq", axes, sigma**2, axes))


def strips_svg(mean: Array, sigma: Array, labels: list[str]) -> Markup:
    """One row per object, one cell per component: its colour the deviation from the average, pale where uncertain."""
    count, length = mean.shape
    spread = np.maximum(mean.std(axis=0), 1e-9)
    deviation = np.clip((mean - mean.mean(axis=0)) / (2.0 * spread), -1.0, 1.0)
    certainty = spread / np.hypot(spread, sigma)
    cell = (WIDTH - LABEL) / length
    parts = []
    for row, label in enumerate(labels):
        y = row * ROW
        parts.append(Markup('<text class="note" x="0" y="{}">{}</text>').format(y + 15, label))
        for column in range(length):
            fill = _colour(float(deviation[row, column] * certainty[row, column]))
            title = f"e{column + 1} = {mean[row, column]:.2f} ± {sigma[row, column]:.2f}"
            box = (f"{LABEL + column * cell:.1f}", y + 1, f"{cell - 1:.1f}", ROW - 2)
            template = '<rect fill="{}" x="{}" y="{}" width="{}" height="{}"><title>{}</title></rect>'
            parts.append(Markup(template).format(fill, *box, title))
    opening = Markup('<svg class="plot" role="img" aria-label="descriptors of {} objects" viewBox="0 0 {} {}">')
    return opening.format(count, WIDTH, count * ROW) + Markup("").join(parts) + Markup("</svg>")


def _colour(value: float) -> str:
    """Colour of a value from -1 to 1: from blue over near white to orange."""
    end = HIGH if value > 0.0 else LOW
    red, green, blue = np.rint(244 + abs(value) * (end - 244)).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"


def plane_svg(points: Array, covariances: Array, labels: list[str], fills: list[str]) -> Markup:
    """Objects at (O, 2) points with ellipses of one standard deviation."""
    reach = np.sqrt(np.einsum("oii->oi", covariances))
    low, high = (points - reach).min(axis=0), (points + reach).max(axis=0)
    scale = (MAP_SIZE - 2 * MAP_MARGIN) / max(float((high - low).max()), 1e-9)
    middle = 0.5 * (low + high)
    parts = []
    for point, covariance, label, fill in zip(points, covariances, labels, fills, strict=True):
        x, y = MAP_SIZE / 2.0 + scale * (point - middle) * (1.0, -1.0)
        values, vectors = np.linalg.eigh(covariance)
        minor, major = scale * np.sqrt(np.maximum(values, 0.0))
        angle = -np.rad2deg(np.arctan2(vectors[1, 1], vectors[0, 1]))
        shape = (f"{major:.1f}", f"{minor:.1f}", f"translate({x:.1f} {y:.1f}) rotate({angle:.1f})")
        template = '<ellipse fill="{0}" fill-opacity="0.18" stroke="{0}" rx="{1}" ry="{2}" transform="{3}"/>'
        parts.append(Markup(template).format(fill, *shape))
        parts.append(Markup('<circle fill="{}" cx="{}" cy="{}" r="3.5"/>').format(fill, f"{x:.1f}", f"{y:.1f}"))
        parts.append(Markup('<text class="note" x="{}" y="{}">{}</text>').format(f"{x + 6:.1f}", f"{y - 5:.1f}", label))
    opening = Markup('<svg class="plot" role="img" aria-label="map of the latent space" viewBox="0 0 {0} {0}">')
    return opening.format(MAP_SIZE) + Markup("").join(parts) + Markup("</svg>")
