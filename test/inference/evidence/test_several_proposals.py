"""Samples of a proposal that is adapted again and again, against an integral that is known."""

from dataclasses import dataclass

import numpy as np
import pytest

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.importance import Gaussians, adapted, draw, proposal, weighed

LOG_EVIDENCE, SIZE, SPREAD = -3.0, 21, 0.5


@dataclass(frozen=True)
class _Bent:
    """A Gaussian that is bent along its first coordinate, relative to the prior: shears keep its integral."""

    bend: Array  # (SIZE - 1,)

    def log_target(self, y: Array) -> Array:
        straight = np.concatenate([y[:, :1], y[:, 1:] - self.bend * (y[:, :1] ** 2 - SPREAD**2)], axis=1) / SPREAD
        return np.asarray(LOG_EVIDENCE - 0.5 * (straight**2 - y**2).sum(axis=1) - SIZE * np.log(SPREAD))

    def mode(self) -> Gaussians:
        """The proposal at the mode, by its Hessian (to first order in the square of the bend)."""
        centre = np.append(0.0, -self.bend * SPREAD**2)
        return proposal(centre[None], np.eye(SIZE)[None] / SPREAD**2, np.zeros(1))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("count", "tolerance"), [(256, 0.15), (1024, 0.05)])
def test_what_was_fitted_to_few_samples_has_the_integral(seed: int, count: int, tolerance: float) -> None:
    """With the points that a proposal was fitted to, 256 samples tell 0.2 to 0.4 nats too little."""
    target = _Bent(0.25 * np.random.default_rng(seed).normal(size=SIZE - 1))
    mixture, sets = target.mode(), []
    for number in range(4):
        sets += draw(target, [mixture], count, [number * count // 2])
        mixture = adapted(mixture, weighed(sets))
    assert weighed(sets).part()[0] == pytest.approx(LOG_EVIDENCE, abs=tolerance)


def test_a_tail_that_one_proposal_misses_is_told_by_another() -> None:
    """The narrow one alone tells far too little."""
    target = _Bent(np.zeros(SIZE - 1))
    narrow, wide = (
        Gaussians(np.zeros((1, SIZE)), np.eye(SIZE)[None] / scale, np.zeros(1)) for scale in (0.4 * SPREAD, SPREAD)
    )
    (alone,), (other,) = (draw(target, [mixture], 1024) for mixture in (narrow, wide))
    assert weighed([alone]).part()[0] < LOG_EVIDENCE - 1.0
    assert weighed([alone, other]).part()[0] == pytest.approx(LOG_EVIDENCE, abs=0.05)


def test_proposals_have_their_own_points_from_a_number_on() -> None:
    target, mixture = _Bent(np.zeros(SIZE - 1)), Gaussians(np.zeros((1, SIZE)), np.eye(SIZE)[None], np.zeros(1))
    every, first, later = (draw(target, [mixture], count, [at])[0] for count, at in ((32, 0), (16, 0), (16, 8)))
    np.testing.assert_array_equal(np.concatenate([first.y[:8], later.y[:8]]), every.y[:16])
    np.testing.assert_array_equal(later.y[8:], -later.y[:8])
    together = draw(target, [mixture] * 3, 16, [0, 8, 0])
    for own, expected in zip(together, (first, later, first), strict=True):
        np.testing.assert_array_equal(own.log_joint, expected.log_joint)
