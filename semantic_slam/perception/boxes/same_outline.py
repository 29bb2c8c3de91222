"""Merging of detections in one frame that show one object under several labels, such as a laptop also called a tv.

Separate solid objects do not share one image outline: the nearer one occludes the other. Nor are they at one place,
which tells where detections have no boxes. Split objects, and objects merged with a neighbour, have other outlines than
the object; these are left to births, misses and false alarms.
"""

from dataclasses import replace

import numpy as np

from semantic_slam.configuration import Configuration, PerceptionConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.perception.measurement import SemanticMeasurements


def overlaps(boxes: Array, others: Array) -> Array:
    """(D, E) intersection over union of boxes (D, 4) and (E, 4), x_min y_min x_max y_max.

    It is 0 where a box is missing or empty.
    """
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    shared = _area(high - low)
    areas, of_others = (_area(own[:, 2:] - own[:, :2]) for own in (boxes, others))
    union = areas[:, None] + of_others - shared
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nan_to_num(shared / union))


def _area(sides: Array) -> Array:
    """(...,) areas of rectangles with side lengths (..., 2); 0 where a side is negative."""
    longer = np.maximum(sides, 0.0)
    return np.asarray(longer[..., 0] * longer[..., 1])


def joined(measurements: SemanticMeasurements, configuration: Configuration) -> SemanticMeasurements:
    """Merge detections of one object into the best-scored one, which keeps the class scores of all.

    A box is merged into the best one that it overlaps by ``perception.same_outline`` or more, a detection without a box
    into the best one without that is less than ``perception.same_place_m`` away. Different track ids stay separate, as
    do places with ``association: given``, whose identities may come with another message.
    """
    if len(measurements) < 2:
        return measurements
    settings = configuration.perception
    same = _same_outline(measurements, settings)
    if configuration.association != "given":
        same = same | _same_place(measurements, settings)
    leaders = _leaders(measurements, same)
    kept = np.unique(leaders)
    if len(kept) == len(leaders):
        return measurements
    told = _with_all_names(measurements)
    scores, names = told.class_scores.copy(), list(told.track_ids)
    for row, leader in enumerate(leaders.tolist()):
        scores[leader] = np.fmax(scores[leader], told.class_scores[row])
        names[leader] = names[leader] or names[row]
    return replace(told, class_scores=scores, track_ids=tuple(names)).take(kept)


def _same_outline(measurements: SemanticMeasurements, settings: PerceptionConfiguration) -> Flags:
    """(D, D) whether two boxes have one outline."""
    if settings.same_outline >= 1.0:
        return np.zeros((len(measurements),) * 2, dtype=bool)
    return overlaps(measurements.boxes, measurements.boxes) >= settings.same_outline


def _same_place(measurements: SemanticMeasurements, settings: PerceptionConfiguration) -> Flags:
    """(D, D) whether two detections without boxes are at one place."""
    places, sides = measurements.places, measurements.boxes[:, 2:] - measurements.boxes[:, :2]
    has_box = _area(np.nan_to_num(sides)) > 0.0
    distances = np.linalg.norm(places[:, None] - places[None], axis=-1)
    return np.asarray((distances < settings.same_place_m) & ~has_box[:, None] & ~has_box)


def _leaders(measurements: SemanticMeasurements, same: Flags) -> Index:
    """(D,) index of the best detection of the same object; the detection itself where none is better."""
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
    """Add each label's score to the class scores, where the classes are the detector's and not a network's."""
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
