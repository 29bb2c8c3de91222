"""Colours of classes: Okabe and Ito's set, distinguishable with any colour vision."""

CLASS_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#b5a900", "#7a5195")
OTHER_COLOUR = "#8c96a0"


def class_colours(count: int) -> list[str]:
    """One colour per class; beyond the set, the last ones share a grey."""
    return [*CLASS_COLOURS[:count], *[OTHER_COLOUR] * max(0, count - len(CLASS_COLOURS))]
