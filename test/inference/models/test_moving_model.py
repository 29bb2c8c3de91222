"""Motion model of moving objects: its closed form in decimals, and its limits of short and long times."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from semantic_slam.configuration import MovingConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.moving import Moving

DIGITS = 90
"""Enough for times of 1e-18 of the steadiness, whose cube is what remains of numbers near 1."""


def in_decimals(elapsed_s: float, steadiness_s: float) -> tuple[Array, Array]:
    """The transition and noise (2, 2) of one coordinate of an Ornstein-Uhlenbeck velocity of 1 m/s, and its rate."""
    with localcontext(prec=DIGITS):
        steady = Decimal(steadiness_s)
        ratio = Decimal(elapsed_s) / steady
        keeps = (-ratio).exp()
        lost = 1 - keeps
        place, both = steady**2 * (2 * ratio - 2 * lost - lost**2), steady * lost**2
        transition = [[1, steady * lost], [0, keeps]]
        noise = [[place, both], [both, 1 - keeps**2]]
        return np.array(transition, dtype=np.float64), np.array(noise, dtype=np.float64)


@pytest.mark.parametrize("steadiness_s", [1e-3, 0.5, 1.99, 2.01, 10.0, 1e3, 1e4, 1e6, 1e8, 1e12, 1e15])
@pytest.mark.parametrize("elapsed_s", [1e-3, 0.1, 1.0, 30.0])
def test_the_motion_of_what_moves_has_its_closed_form_however_steady_it_is(
    elapsed_s: float, steadiness_s: float
) -> None:
    moving = Moving(MovingConfiguration(steadiness_s=steadiness_s))
    transition, noise = in_decimals(elapsed_s, steadiness_s)
    np.testing.assert_allclose(moving.unit_transition(elapsed_s), transition, rtol=1e-13)
    np.testing.assert_allclose(moving.unit_noise(elapsed_s), noise, rtol=1e-13)


def test_a_very_steady_velocity_is_constant() -> None:
    moving = Moving(MovingConfiguration(steadiness_s=1e15))
    np.testing.assert_allclose(moving.unit_transition(2.0), [[1.0, 2.0], [0.0, 1.0]], rtol=1e-12)
    np.testing.assert_allclose(moving.unit_noise(2.0), 0.0, atol=1e-14)


def test_a_velocity_that_does_not_last_makes_a_random_walk() -> None:
    moving = Moving(MovingConfiguration(steadiness_s=1e-3))
    np.testing.assert_allclose(moving.unit_noise(10.0)[0, 0], 2.0 * 1e-3 * 10.0, rtol=1e-3)
    np.testing.assert_allclose(moving.unit_transition(10.0), [[1.0, 1e-3], [0.0, 0.0]], atol=1e-12)
