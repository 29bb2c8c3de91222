"""What was seen little is doubted where it has the scores of what was never there again, and nowhere else."""

import numpy as np
import pytest

from semantic_slam.inference.semantics.detector.alarm_scores import AlarmScores
from semantic_slam.inference.semantics.detector.detector_scores import moments_of

THINGS, ALARMS, SIGMA = 1.0, -0.5, 0.6
"""Means of the log odds of scores, and their standard deviation."""


def drawn(mean: float, objects: int, views: int, seed: int) -> np.ndarray:
    """(N, 3) moments of the scores of objects that are seen so often."""
    odds = np.random.default_rng(seed).normal(mean, SIGMA, (objects, views))
    return np.asarray(moments_of(odds).sum(axis=1))


def learned(alarms_mean: float, num_alarms: int, num_things: int = 20) -> AlarmScores | None:
    """From things that were seen three times, and false alarms that were looked for in vain."""
    moments = np.concatenate([drawn(THINGS, num_things, 3, 0), drawn(alarms_mean, num_alarms, 1, 1)])
    return AlarmScores.of(moments, np.repeat([1.0, 0.0], [num_things, num_alarms]))


def existence(scores: AlarmScores, by_places: float, odds: float) -> float:
    return float(scores.weighed(np.array([by_places]), moments_of(np.array([odds])))[0])


def test_a_first_sight_is_weighed_by_the_densities_of_its_score() -> None:
    """Against the closed form, with the moments that the scores were drawn from."""
    found = learned(ALARMS, 500, 500)
    assert found is not None and found.probability > 0.999
    for odds in (-1.5, -0.5, 0.25, 2.0):
        log_ratio = ((odds - ALARMS) ** 2 - (odds - THINGS) ** 2) / (2.0 * SIGMA**2)
        expected = 0.7 / (0.7 + 0.3 * np.exp(-log_ratio))
        assert existence(found, 0.7, odds) == pytest.approx(expected, abs=0.05)


def test_few_false_alarms_tell_little() -> None:
    few, many = learned(ALARMS, 1), learned(ALARMS, 40)
    assert few is not None and many is not None
    assert existence(few, 0.9, -0.8) > 0.7
    assert existence(many, 0.9, -0.8) < 0.3


@pytest.mark.parametrize("alarms_mean", [THINGS, THINGS + 1.0])
def test_where_alarms_score_no_lower_than_things_nothing_is_doubted(alarms_mean: float) -> None:
    found = learned(alarms_mean, 40)
    assert found is None or existence(found, 0.9, -1.0) == pytest.approx(0.9, abs=0.05)


def test_a_lower_score_is_never_better() -> None:
    found = learned(ALARMS, 40)
    assert found is not None
    told = [existence(found, 0.6, odds) for odds in np.linspace(-20.0, 20.0, 81)]
    assert (np.diff(told) >= 0.0).all() and told[0] < 1e-6 and told[-1] > 1.0 - 1e-6


def test_what_is_certain_stays_so_and_what_has_no_score_is_as_places_have_it() -> None:
    found = learned(ALARMS, 40)
    assert found is not None
    assert existence(found, 1.0, -5.0) == 1.0 and existence(found, 0.0, 5.0) == 0.0
    assert existence(found, 0.4, np.nan) == 0.4
    assert np.isnan(existence(found, np.nan, 0.0))


def test_an_object_is_weighed_by_its_mean_score_however_often_it_was_seen() -> None:
    found = learned(ALARMS, 40)
    assert found is not None
    once, often = moments_of(np.array([-0.3])), moments_of(np.full(9, -0.3)).sum(axis=0)[None]
    np.testing.assert_allclose(found.weighed(np.array([0.8]), once), found.weighed(np.array([0.8]), often))


@pytest.mark.parametrize("odds", [[], [np.nan, np.nan], [1.3, 1.3, 1.3]])
def test_scores_that_are_not_told_or_all_alike_tell_nothing(odds: list[float]) -> None:
    assert AlarmScores.of(moments_of(np.array(odds, dtype=np.float64)), np.full(len(odds), 0.5)) is None


def test_one_thing_that_is_stared_at_counts_as_one() -> None:
    """Seen a thousand times, with larger scores than all others."""
    others, alarms = drawn(THINGS, 19, 5, 0), drawn(ALARMS, 20, 1, 1)
    told = []
    for views in (5, 1000):
        stared_at = moments_of(np.full(views, 5.0)).sum(axis=0)[None]
        found = AlarmScores.of(np.concatenate([others, stared_at, alarms]), np.repeat([1.0, 0.0], [20, 20]))
        assert found is not None
        told.append(existence(found, 0.7, THINGS))
    assert told[0] == pytest.approx(told[1], abs=1e-9) and told[0] > 0.6
