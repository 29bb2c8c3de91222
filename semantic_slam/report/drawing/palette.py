"""Colours of classes: Okabe and Ito's set, distinguishable with any colour vision."""

import numpy as np

from semantic_slam.geometry.arrays import Array

CLASS_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#b5a900", "#7a5195")
OTHER_COLOUR = "#8c96a0"


def class_colours(count: int) -> list[str]:
    """One colour per class; beyond the set, the last ones share a grey."""
    return [*CLASS_COLOURS[:count], *[OTHER_COLOUR] * max(0, count - len(CLASS_COLOURS))]


def colours_by_weight(weights: Array) -> list[str]:
    """One colour for each of (C,) classes; of more than the set has, those with the largest weights get it."""
    if len(weights) <= len(CLASS_COLOURS):
        return class_colours(len(weights))
    chosen = np.sort(np.argsort(-weights, kind="stable")[: len(CLASS_COLOURS)]).tolist()
    colour_of = dict(zip(chosen, CLASS_COLOURS, strict=True))
    return [colour_of.get(number, OTHER_COLOUR) for number in range(len(weights))]
