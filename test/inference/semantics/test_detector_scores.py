"""Scores of two kinds are told apart where there are two, and nothing is told where there is one."""

import numpy as np
import pytest
from scipy.stats import norm

from semantic_slam.inference.semantics.detector.detector_scores import (
    LARGEST_LOG_ODDS,
    ScoreKinds,
    log_odds,
    moments_of,
)


def two_kinds(rng: np.random.Generator, count: int = 400) -> np.ndarray:
    return np.concatenate([rng.normal(0.5, 1.0, count // 2), rng.normal(8.0, 3.0, count // 2)])


def test_two_kinds_are_found_again() -> None:
    odds = two_kinds(np.random.default_rng(0), 4000)
    kinds = ScoreKinds.of(odds, np.ones(len(odds)))
    assert kinds is not None and kinds.probability > 0.999
    np.testing.assert_allclose(kinds.shares, [0.5, 0.5], atol=0.05)
    np.testing.assert_allclose(kinds.means, [0.5, 8.0], atol=0.4)
    np.testing.assert_allclose(kinds.sigmas, [1.0, 3.0], atol=0.3)


@pytest.mark.parametrize("seed", range(5))
def test_one_kind_tells_of_no_mistakes(seed: int) -> None:
    odds = np.random.default_rng(seed).normal(3.0, 2.0, 500)
    kinds = ScoreKinds.of(odds, np.ones(len(odds)))
    assert kinds is not None
    assert (kinds.genuine(moments_of(np.linspace(-3.0, 9.0, 5))) > 0.9).all()


@pytest.mark.parametrize("scores", [np.ones(500), np.full(500, 0.7), np.linspace(0.1, 0.9, 50)])
def test_scores_that_are_alike_or_few_tell_nothing(scores: np.ndarray) -> None:
    assert ScoreKinds.of(log_odds(scores), np.ones(len(scores))) is None


def test_views_that_repeat_count_as_few() -> None:
    odds = two_kinds(np.random.default_rng(1))
    assert ScoreKinds.of(odds, np.full(len(odds), 0.1)) is None


@pytest.mark.parametrize("counts", [(1.0, 1.0, 1.0), (1.0, 0.4, 0.4)])
def test_scores_of_an_object_tell_as_much_as_they_do_not_repeat(counts: tuple[float, ...]) -> None:
    kinds = ScoreKinds(
        shares=np.array([0.4, 0.6]), means=np.array([0.0, 6.0]), sigmas=np.array([1.0, 3.0]), probability=0.9
    )
    odds = np.array([1.0, 2.5, 4.0])
    ratio = np.array(counts) @ (norm.logpdf(odds, 6.0, 3.0) - norm.logpdf(odds, 0.0, 1.0))
    genuine = 1.0 / (1.0 + 0.4 / 0.6 * np.exp(-ratio))
    np.testing.assert_allclose(kinds.genuine(np.array(counts) @ moments_of(odds)), 1.0 - 0.9 * (1.0 - genuine))


def test_without_scores_an_object_is_genuine() -> None:
    kinds = ScoreKinds(shares=np.array([0.5, 0.5]), means=np.zeros(2), sigmas=np.ones(2), probability=1.0)
    np.testing.assert_array_equal(kinds.genuine(np.zeros((2, 3))), [1.0, 1.0])
    np.testing.assert_array_equal(moments_of(log_odds(np.array([np.nan]))), np.zeros((1, 3)))


def test_certain_scores_stay_finite() -> None:
    np.testing.assert_array_equal(log_odds(np.array([0.0, 0.5, 1.0])), [-LARGEST_LOG_ODDS, 0.0, LARGEST_LOG_ODDS])
