"""Boxes of one frame that show one thing, which a detector calls by several names: a laptop, and the same one a tv.

Solid things that stand apart do not share an outline and the surface that it encloses: the nearer one hides the other.
What is split, or merged with its neighbour, has other outlines than the thing: that stays to births, misses and false
alarms.
"""

from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.perception.measurement import SemanticMeasurements


def overlaps(boxes: Array, others: Array) -> Array:
    """(D, E) intersection over union of boxes (D, 4) and (E, 4), x_min y_min x_max y_max; 0 where one is not given or
    empty.
    """
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    shared = _area(high - low)
    areas, of_others = (_area(own[:, 2:] - own[:, :2]) for own in (boxes, others))
    union = areas[:, None] + of_others - shared
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nan_to_num(shared / union))


def _area(sides: Array) -> Array:
    """(...,) of rectangles with two sides (..., 2); 0 where one is below 0."""
    longer = np.maximum(sides, 0.0)
    return np.asarray(longer[..., 0] * longer[..., 1])


def joined(measurements: SemanticMeasurements, least_overlap: float) -> SemanticMeasurements:
    """One detection for each outline: the one with the best score, with the classes and scores of all.

    A box is joined to the best one that it overlaps by ``least_overlap`` or more; boxes with different identities stay
    apart.
    """
    boxes = measurements.boxes
    if len(measurements) < 2 or least_overlap >= 1.0 or not np.isfinite(boxes).any():
        return measurements
    leaders = _leaders(measurements, overlaps(boxes, boxes) >= least_overlap)
    kept = np.unique(leaders)
    if len(kept) == len(leaders):
        return measurements
    told = _with_all_names(measurements)
    scores, names = told.class_scores.copy(), list(told.track_ids)
    for row, leader in enumerate(leaders.tolist()):
        scores[leader] = np.fmax(scores[leader], told.class_scores[row])
        names[leader] = names[leader] or names[row]
    return replace(told, class_scores=scores, track_ids=tuple(names)).take(kept)


def _leaders(measurements: SemanticMeasurements, same: Flags) -> Index:
    """(D,) for each detection the best one of its outline: itself where there is none better."""
    scores = np.nan_to_num(measurements.scores, nan=-np.inf)
    leaders, leading = np.arange(len(scores)), list[int]()
    for row in np.argsort(-scores, kind="stable").tolist():
        own = measurements.track_ids[row]
        found = [n for n in leading if same[row, n] and len({own, measurements.track_ids[n]} - {""}) < 2]
        if found:
            leaders[row] = found[0]
        else:
            leading.append(row)
    return leaders


def _with_all_names(measurements: SemanticMeasurements) -> SemanticMeasurements:
    """With the score of each label among those of the classes, where classes are the detector's and not a network's."""
    if measurements.class_probability_samples.shape[1] > 0:
        return measurements
    names = tuple(dict.fromkeys((*measurements.class_names, *sorted({*measurements.labels} - {""}))))
    scores = np.full((len(measurements), len(names)), np.nan)
    scores[:, : len(measurements.class_names)] = measurements.class_scores
    for row, label in enumerate(measurements.labels):
        if label:
            column = names.index(label)
            scores[row, column] = np.fmax(scores[row, column], measurements.scores[row])
    samples = np.zeros((len(measurements), 0, len(names)))
    return replace(measurements, class_names=names, class_scores=scores, class_probability_samples=samples)
