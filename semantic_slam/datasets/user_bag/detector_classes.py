"""The classes of a detector's scores, the same in all messages of a bag: known once a run starts."""

from dataclasses import replace

import numpy as np

from semantic_slam.perception.frame import Detections


def class_names_of(detections: Detections) -> frozenset[str]:
    """Every label and every class that a detector's message names."""
    return frozenset((*detections.labels, *detections.class_names)) - {""}


def with_class_names(detections: Detections, names: tuple[str, ...]) -> Detections:
    """The detections with scores (D, C) of those classes, NaN where not reported; further classes are left out."""
    scores = np.full((len(detections), len(names)), np.nan)
    for column, name in enumerate(detections.class_names):
        if name in names:
            scores[:, names.index(name)] = detections.class_scores[:, column]
    return replace(detections, class_names=names, class_scores=scores)


def renamed(detections: Detections, mapping: dict[str, str | None]) -> Detections:
    """With the classes of the scores renamed; those of None, or not listed, are left out, names that meet add up."""
    names = tuple(sorted({str(mapping[name]) for name in detections.class_names if mapping.get(name) is not None}))
    scores = np.full((len(detections), len(names)), np.nan)
    for column, name in enumerate(detections.class_names):
        if mapping.get(name) is None:
            continue
        at, told = names.index(str(mapping[name])), detections.class_scores[:, column]
        scores[:, at] = np.where(np.isnan(told), scores[:, at], np.nan_to_num(scores[:, at]) + np.nan_to_num(told))
    return replace(detections, class_names=names, class_scores=scores)
