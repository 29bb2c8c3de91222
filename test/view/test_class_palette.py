"""Colours of classes in the live view, where there are more classes than colours."""

import dataclasses

import numpy as np
from worlds.belief_factory import small_belief

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.report.drawing.palette import CLASS_COLOURS, OTHER_COLOUR
from semantic_slam.view.class_palette import ClassPalette

NAMES = tuple(f"class {number}" for number in range(len(CLASS_COLOURS) + 4))


def with_existence(existence: list[float]) -> HybridBelief:
    """One object of each class, of which each exists with the probability given."""
    belief = small_belief(0, [1], [0], [1.0], range(len(NAMES)), [[0]], NAMES)
    return dataclasses.replace(
        belief, class_probabilities=np.eye(len(NAMES)), existence=np.array(existence, dtype=np.float64)
    )


def test_objects_that_hardly_exist_use_up_no_colours() -> None:
    ghosts = [0.1] * 4 + [1.0] * len(CLASS_COLOURS)
    assert ClassPalette().of(with_existence(ghosts)) == [OTHER_COLOUR] * 4 + list(CLASS_COLOURS)


def test_a_run_that_does_not_doubt_existence_colours_what_it_meets_first() -> None:
    unknown = [float("nan")] * len(NAMES)
    assert ClassPalette().of(with_existence(unknown)) == [*CLASS_COLOURS, *[OTHER_COLOUR] * 4]


def test_a_colour_is_kept_when_its_object_turns_out_not_to_exist() -> None:
    palette, everything = ClassPalette(), [1.0] * len(NAMES)
    before = palette.of(with_existence(everything))
    assert palette.of(with_existence([0.0] * 4 + everything[4:])) == before
