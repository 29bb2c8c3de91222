"""The second words of a detector: where its first ones are wrong, the truth is often second."""

import numpy as np
import pytest
from scipy.special import gammaln

from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, Confusion
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord
from semantic_slam.viewpoint.labels.runner_up import EVEN_HABITS, HABITS, NONE, RunnersUp, RunnerUp, truth_second
from semantic_slam.viewpoint.labels.settings import LabelSettings

WORDS = 5
CUP, TV, BED, SINK, OTHER = range(WORDS)
MODEL = LabelModel(
    labels=("cup", "tv", "bed", "sink"),
    settings=LabelSettings.grid((0.0, 0.95), (0.5,), (1.0, 10.0)),
    confusions=(Confusion.symmetric(WORDS - 1, 0.75, 4.0, 0.05),),
    class_shares=np.full(WORDS, 1.0 / WORDS),
)


def seconds(seen: list[RunnerUp], habits: np.ndarray = EVEN_HABITS) -> tuple[RunnersUp, np.ndarray]:
    """What second words leave known of an object, and (C,) their log likelihood relative to any word alike."""
    found, told = RunnersUp.start(WORDS, habits), np.zeros(WORDS)
    for own in seen:
        following = found.following(own)
        assert following is not None
        found, told = following.after, told + following.gained
    return found, told


def anew(first: int, second: int) -> RunnerUp:
    return RunnerUp(first=first, second=second, earlier=NONE, away=np.inf)


def again(away: float) -> RunnerUp:
    return RunnerUp(first=TV, second=CUP, earlier=CUP, away=away)


def called(words: list[tuple[int, int]], step: int = 6) -> np.ndarray:
    """(C,) probabilities of the classes of an object with these first and second words, from directions in turn."""
    record = MODEL.start()
    for number, (first, second) in enumerate(words):
        shares = np.full(WORDS, 0.02)
        shares[[first, second]] = 0.64, 0.3
        view = LabelView(
            word=LabelWord(answer=first, shares=shares), direction=step * number % DIRECTIONS, log_range=0.0
        )
        record = MODEL.after(record, view)
    logs = MODEL.class_log_likelihood(record)
    return np.asarray(np.exp(logs) / np.exp(logs).sum())


def test_second_words_count_as_the_dirichlet_integral_has_it() -> None:
    """Of an object that is always called a cup, for each class and habit."""
    words = [BED, TV, BED, BED, OTHER]
    each = np.eye(len(EVEN_HABITS))
    found = np.array([seconds([anew(CUP, word) for word in words], own)[1] for own in each])
    counts = np.bincount(words, minlength=WORDS)[1:]
    for column in range(WORDS):
        for (share, _, views), told in zip(HABITS.T, found[:, column], strict=True):
            truth = 0.25 + 0.75 * share
            prior = np.full(WORDS, (1.0 - truth) / 3.0)
            prior[column] = truth
            prior = views * (np.full(4, 0.25) if column in (CUP, OTHER) else prior[1:])
            after = prior + counts
            exact = gammaln(after).sum() - gammaln(after.sum()) - gammaln(prior).sum() + gammaln(prior.sum())
            assert told == pytest.approx(exact + len(words) * np.log(4.0))


def test_second_words_have_probabilities_that_sum_to_one() -> None:
    before, _ = seconds([anew(CUP, TV), anew(CUP, BED), anew(TV, CUP)])
    every = [RunnerUp(first=CUP, second=word, earlier=BED, away=0.2) for word in range(WORDS) if word != CUP]
    gained = [following.gained for following in map(before.following, every) if following is not None]
    assert len(gained) == WORDS - 1
    np.testing.assert_allclose(np.exp(gained).sum(axis=0) / 4.0, 1.0)


def test_a_view_without_a_second_word_tells_nothing() -> None:
    assert seconds([anew(CUP, TV)])[0].following(anew(CUP, NONE)) is None


def test_the_truth_that_comes_second_names_what_is_called_two_things() -> None:
    """As often a tv as a cup; where it is a tv the cup comes second, and where it is a cup anything does."""
    words = [(TV, CUP), (CUP, BED), (TV, CUP), (CUP, SINK), (TV, CUP), (CUP, TV), (TV, BED), (CUP, BED)]
    alone = called([(TV, BED), (CUP, BED)] * 4)
    assert alone[CUP] == pytest.approx(alone[TV], rel=0.5)
    assert called(words)[CUP] > 5.0 * called(words)[TV]


def test_a_robot_that_stands_hears_the_same_second_word_again() -> None:
    standing, around = (called([(TV, CUP)] * 8, step) for step in (0, 9))
    assert standing[CUP] / standing[TV] < 1.0 and around[CUP] / around[TV] < 1.0  # it is what it is called first
    moved, still = (seconds([anew(TV, CUP), *[again(away)] * 7])[1] for away in (3.0, 0.0))
    assert moved[CUP] - moved[BED] > still[CUP] - still[BED] + 0.5


def test_habits_that_are_known_tell_more() -> None:
    sure = np.where((HABITS[0] == 0.6) & (HABITS[1] == 0.0) & (HABITS[2] == 10.0), 1.0, 1e-6)
    words = [anew(TV, CUP), anew(BED, CUP)]
    known, unknown = (seconds(words, own)[1] for own in (sure / sure.sum(), EVEN_HABITS))
    assert known[CUP] - known[TV] > unknown[CUP] - unknown[TV] + 1.0
    assert seconds(words * 3)[0].habits[CUP] @ HABITS[0] > EVEN_HABITS @ HABITS[0] + 0.1


def test_the_truth_is_second_by_chance_at_least() -> None:
    shares = truth_second(WORDS)
    assert shares.min() == pytest.approx(1.0 / (WORDS - 1)) and shares.max() < 1.0
    assert truth_second(100).min() == pytest.approx(1.0 / 99.0)
