"""Numbers of the maps on the page: rounding makes no doubt disappear."""

import dataclasses

import numpy as np
import pytest
from worlds.belief_factory import small_belief

from semantic_slam.report.shown.keyframe import hypothesis_rows, keyframe_scene


@pytest.mark.parametrize(("sure", "told"), [(0.99997, 0.9996), (0.9996, 0.9996), (0.998, 0.998), (1.0, 1.0)])
def test_a_probability_that_is_nearly_one_is_not_written_as_one(sure: float, told: float) -> None:
    belief = dataclasses.replace(
        small_belief(0, [1, 2], [0, 0], [sure, max(1.0 - sure, 1e-300)], [4], [[0], [0]]),
        class_probabilities=np.array([[0.0, sure, 1.0 - sure]]),
    )
    (row,) = keyframe_scene(belief, belief.stamp_ns, [], {4: 0}, {})["o"]
    assert row[9] == told
    assert hypothesis_rows(belief, [0], {})[0][1] == told


def test_a_probability_that_is_nearly_none_is_not_written_as_none() -> None:
    belief = small_belief(0, [1, 2], [0, 0], [0.99998, 2e-5], [4], [[0], [0]])
    assert hypothesis_rows(belief, [0], {})[0][1] == 0.9996
    assert hypothesis_rows(belief, [0, 1], {})[1][1] == 1e-4
