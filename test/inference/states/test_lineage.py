"""Lineages of days of driving hold every number once."""

import numpy as np

from semantic_slam.inference.states.lineage import LineageStep


def test_steps_that_name_the_same_objects_share_them() -> None:
    """Numbers out of arrays are objects of their own each, of 32 bytes."""
    one, other = (LineageStep.of(np.array([70_001, -1, 70_002]).tolist(), [-1, -1, -1]) for _ in range(2))
    assert one == other == LineageStep((70_001, -1, 70_002), (-1, -1, -1))
    assert all(a is b for a, b in zip(one.association, other.association, strict=True))
    assert one.class_assignment is other.class_assignment
