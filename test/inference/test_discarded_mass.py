"""Discarded mass since the start and of the last keyframes, when some of it is found again."""

import numpy as np
import pytest

from semantic_slam.inference.hypotheses import RECENT_KEYFRAMES, DiscardedMass


def discarded(*kept: float) -> DiscardedMass:
    """The mass after keyframes that kept these shares."""
    mass = DiscardedMass()
    for share in kept:
        mass.add(np.log(share))
    return mass


def test_what_is_found_again_is_taken_off_every_keyframe_that_may_have_discarded_it() -> None:
    mass = discarded(0.6, 0.99, 1.0)
    mass.find(np.log(1 / 0.99))
    assert mass.total == pytest.approx(0.4) and mass.window == pytest.approx(0.4)
    mass.find(np.log(0.9 / 0.6))
    assert mass.total == pytest.approx(0.1) and mass.window == pytest.approx(0.1)
    mass.find(0.6)
    assert (mass.total, mass.window) == (0.0, 0.0)


def test_the_last_keyframes_are_a_part_of_the_whole_however_much_is_found_again() -> None:
    generator, mass = np.random.default_rng(4), DiscardedMass()
    for _ in range(10 * RECENT_KEYFRAMES):
        mass.add(-generator.exponential(0.1))
        if generator.random() < 0.3:
            mass.find(generator.exponential(0.4))
        assert 0.0 <= mass.window <= mass.total < 1.0


def test_what_older_keyframes_discarded_stays_in_the_sum_alone() -> None:
    mass = discarded(0.5, *[1.0] * RECENT_KEYFRAMES)
    mass.find(np.log(1.2))
    assert mass.total == pytest.approx(0.4) and mass.window == 0.0
