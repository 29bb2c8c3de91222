"""A detector's words: what they tell of a class follows from what may have been repeated, new or an outlier."""

import itertools

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import dirichlet

from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, HIDDEN_NONE, STEP_RAD, Confusion
from semantic_slam.viewpoint.labels.model import NONE_OF_THESE, LabelModel
from semantic_slam.viewpoint.labels.record import LabelRecord, LabelView, LabelWord
from semantic_slam.viewpoint.labels.settings import LabelSettings
from semantic_slam.viewpoint.labels.views import FirstView, LaterView

LABELS = ("chair", "cup", "tv")
REPEAT_SHARES, REPEAT_RAD = (0.0, 0.5, 0.95), 0.5


def unfitted(labels=LABELS, counts=4.0, outlier_share=0.05, repeat_shares=REPEAT_SHARES) -> LabelModel:
    """A model before anything was counted."""
    return LabelModel(
        labels=labels,
        settings=LabelSettings.grid(repeat_shares, (REPEAT_RAD,), (1.0,)),
        confusions=(Confusion.symmetric(len(labels), 0.75, counts, outlier_share),),
        class_shares=np.full(len(labels) + 1, 1.0 / (len(labels) + 1)),
    )


MODEL = unfitted()
FRESH = unfitted(outlier_share=0.0, repeat_shares=(0.0,))
PRIOR = FRESH.priors[0][0]
View = tuple[int, np.ndarray, int, float]  # word, scores of all words, direction, log of the distance


def certain(word: int, direction: int = 0, log_range: float = 0.0) -> View:
    return word, np.eye(MODEL.num_words)[word], direction, log_range


def unsure(word: int, scores: list[float], direction: int = 0) -> View:
    return word, np.array(scores), direction, 0.0


def viewed(answer: int, shares: np.ndarray, direction: int, log_range: float) -> LabelView:
    return LabelView(word=LabelWord(answer=answer, shares=shares), direction=direction, log_range=log_range)


def seen(model: LabelModel, views: list[View]) -> LabelRecord:
    record = model.start()
    for view in views:
        record = model.after(record, viewed(*view))
    return record


def told(model: LabelModel, views: list[View]) -> np.ndarray:
    return model.class_log_likelihood(seen(model, views))


def test_before_the_first_view_nothing_is_told():
    np.testing.assert_array_equal(told(MODEL, []), np.zeros(4))
    assert MODEL.class_names == (*LABELS, NONE_OF_THESE)


def test_new_words_count_as_the_dirichlet_integral_has_it():
    """P(words | c) = B(alpha + n) / B(alpha), whatever their order."""
    words = [0, 0, 1, 0, 3]
    found = seen(FRESH, [certain(word) for word in words]).log_likelihood[0]
    counts = np.bincount(words, minlength=4)
    for row, prior in zip(found, PRIOR, strict=True):
        after = prior + counts
        exact = gammaln(after).sum() - gammaln(after.sum()) - gammaln(prior).sum() + gammaln(prior.sum())
        assert row == pytest.approx(exact)


def test_the_confusion_is_integrated_out():
    """The same number as by draws of the rows of probabilities."""
    model = unfitted(counts=20.0, outlier_share=0.0, repeat_shares=(0.0,))
    words = [0, 1, 0]
    found = seen(model, [certain(word) for word in words]).log_likelihood[0]
    for row, prior in zip(found, model.priors[0][0], strict=True):
        theta = dirichlet(prior).rvs(200_000, random_state=0)
        assert np.exp(row) == pytest.approx(theta[:, words].prod(axis=1).mean(), rel=0.05)


def test_repeats_outliers_and_new_answers_are_all_taken_together():
    """With a confusion that is known: the sum over what each view may have been, for every setting."""
    model = unfitted(counts=1e9)
    views = [certain(0), certain(0, 3), certain(1, 4), certain(1, 20), certain(0, 2), certain(1, 21)]
    found = seen(model, views).log_likelihood
    theta = PRIOR / PRIOR.sum(axis=1, keepdims=True)
    for number, share in enumerate(REPEAT_SHARES):
        for row in range(len(theta)):
            exact = sum(_joint(model, views, kinds, share, theta[row]) for kinds in _kinds(len(views)))
            assert found[number, row] == pytest.approx(np.log(exact), abs=1e-6)


def _kinds(count: int) -> list[tuple[str, ...]]:
    return list(itertools.product(("repeated", "new", "outlier"), repeat=count))


def _joint(model: LabelModel, views: list[View], kinds: tuple[str, ...], share: float, theta: np.ndarray) -> float:
    """P(words, what each view was)."""
    total, earlier = 1.0, dict[int, int]()
    for (word, _, direction, _), kind in zip(views, kinds, strict=True):
        repeats, nearest = 0.0, -1
        if earlier:
            away = {n: STEP_RAD * min((n - direction) % DIRECTIONS, (direction - n) % DIRECTIONS) for n in earlier}
            nearest = min(away, key=away.__getitem__)
            repeats = share * np.exp(-away[nearest] / REPEAT_RAD)
        if kind == "repeated":
            total *= repeats * (earlier.get(nearest) == word)
        elif kind == "new":
            total *= (1.0 - repeats) * (1.0 - model.confusions[0].outlier_share) * theta[word]
        else:
            total *= (1.0 - repeats) * model.confusions[0].outlier_share / model.num_words
        earlier[direction] = word
    return total


def test_views_from_every_distance_and_direction_are_remembered():
    """With a confusion that is known: the product over views of the kernel to the nearest of all earlier ones."""
    random, model = np.random.default_rng(0), unfitted(counts=1e9)
    cells = random.integers([8, 20], size=(60, 2)) * [2, 3] + [66, -12]
    views = [certain(int(random.integers(4)), int(cell) % DIRECTIONS, STEP_RAD * step) for cell, step in cells]
    found = seen(model, views).log_likelihood
    theta = PRIOR / PRIOR.sum(axis=1, keepdims=True)
    for number, share in enumerate(REPEAT_SHARES):
        exact = sum(np.log(_given_all_before(views[: n + 1], share, theta)) for n in range(len(views)))
        np.testing.assert_allclose(found[number], exact, atol=1e-6)


def _given_all_before(views: list[View], share: float, theta: np.ndarray) -> np.ndarray:
    """(K,) probabilities of the last word given all earlier ones; of equally near ones the lowest cell counts."""
    outlier, (*earlier, (word, _, direction, log_range)) = MODEL.confusions[0].outlier_share, views
    new = (1.0 - outlier) * theta[:, word] + outlier / MODEL.num_words
    if not earlier:
        return new
    newest = {(cell, away): told for told, _, cell, away in earlier}
    turns = {place: abs((place[0] - direction + 36) % DIRECTIONS - 36) * STEP_RAD for place in newest}
    away = {place: np.hypot(turns[place], place[1] - log_range) for place in newest}
    nearest = min(sorted(away), key=lambda place: round(away[place], 9))
    repeats = share * np.exp(-away[nearest] / REPEAT_RAD)
    return repeats * (newest[nearest] == word) + (1.0 - repeats) * new


@pytest.mark.parametrize("near", [0.5, 0.9])
def test_a_robot_that_goes_back_and_forth_between_two_places_hears_what_it_heard_there(near):
    """Each place repeats its own first answer: as views from two directions that are as far apart."""
    apart = round(np.log(3.0 / near) / STEP_RAD)
    there = told(MODEL, [certain(0, log_range=STEP_RAD * apart * (number % 2)) for number in range(20)])
    around = told(MODEL, [certain(0, apart * (number % 2)) for number in range(20)])
    np.testing.assert_allclose(there, around, rtol=1e-12)
    assert np.exp(there[0]) / np.exp(there).sum() < 0.95


def test_as_many_views_are_remembered_as_there_are_places():
    around = [certain(0, cell, STEP_RAD * step) for cell in (0, 9, 30) for step in (-3, 0, 12)]
    newest = seen(MODEL, [certain(1, *view[2:]) for view in around] + around * 2).newest
    assert len(newest.directions) == len(around) and not newest.words[0].any()


def test_a_first_view_counts_as_any_other_does_where_nothing_was_said_before():
    view, start = viewed(*unsure(0, [0.5, 0.3, 0.1, 0.1])), MODEL.start()
    short, whole = (kind.of(MODEL, start, view, MODEL.drawn(view)).record for kind in (FirstView, LaterView))
    assert short.words == whole.words
    for name in ("log_likelihood", "counts"):
        np.testing.assert_allclose(getattr(short, name), getattr(whole, name), rtol=1e-12, atol=0.0)
    assert short.newest.nearest(view) == whole.newest.nearest(view) == (0, 1, 0.0)


def test_what_is_filtered_is_near_what_is_exact():
    """With an unknown confusion which answers are new is not known: the exact sum counts only those."""
    model = unfitted(repeat_shares=(0.5,))
    views = [certain(0), certain(0, 3), certain(1, 4), certain(0, 20), certain(0, 21)]
    found = seen(model, views).log_likelihood[0]
    exact = np.array([_exact(model, views, 0.5, prior) for prior in PRIOR])
    np.testing.assert_allclose(found, exact, atol=0.15)


def _exact(model: LabelModel, views: list[View], share: float, prior: np.ndarray) -> float:
    total = 0.0
    for kinds in _kinds(len(views)):
        counts, theta = prior.copy(), 1.0
        for (word, *_), kind in zip(views, kinds, strict=True):
            if kind == "new":
                theta *= counts[word] / counts.sum()
                counts[word] += 1.0
        even = np.ones(model.num_words)  # theta is accounted for by the counts
        total += theta * _joint(model, views, kinds, share, even)
    return float(np.log(total))


def test_scores_are_averaged_over_what_they_may_mean():
    scores = [0.5, 0.3, 0.1, 0.1]
    by_word, by_score = seen(
        unfitted(counts=1e9, outlier_share=0.0, repeat_shares=(0.0,)), [unsure(0, scores)]
    ).log_likelihood
    theta = PRIOR / PRIOR.sum(axis=1, keepdims=True)
    second = np.array([1.0, 1.6, 0.7, 1.0, 1.0])  # of the second word, on average over habits; see test_label_runner_up
    np.testing.assert_allclose(np.exp(by_word), theta[:, 0] * second, rtol=1e-6)
    np.testing.assert_allclose(np.exp(by_score), theta @ scores, rtol=1e-6)


def test_names_are_names_alone():
    """Labels in another order are the same classes in that order."""
    order = np.array([2, 0, 1, 3])
    views = [unsure(0, [0.6, 0.2, 0.1, 0.1]), unsure(1, [0.3, 0.4, 0.2, 0.1], 9), certain(0, 30)]
    moved = [(int(np.flatnonzero(order == word)[0]), scores[order], *where) for word, scores, *where in views]
    np.testing.assert_allclose(told(MODEL, moved), told(MODEL, views)[order], rtol=0.0, atol=1e-12)


def test_a_robot_that_stands_learns_less_than_one_that_drives_around():
    standing = told(MODEL, [certain(0)] * 12)
    around = told(MODEL, [certain(0, 6 * number) for number in range(12)])
    assert around[0] - around[1] > standing[0] - standing[1] + 1.0
    assert standing[0] - standing[1] < 8.0


def test_an_object_that_is_called_everything_is_none_of_these():
    many = unfitted(tuple(f"label_{n}" for n in range(30)))
    views = [(word, np.eye(31)[word], 6 * word % DIRECTIONS, 0.0) for word in range(10)]
    assert int(np.argmax(told(many, views))) == 30


def test_what_has_other_names_is_none_of_these():
    around = [certain(len(LABELS), 9 * number) for number in range(4)]
    assert int(np.argmax(told(MODEL, around))) == len(LABELS)


def test_views_without_a_word_tell_nothing_of_the_class():
    even = np.full(4, 0.25)
    found = told(MODEL, [(-1, even, 0, 0.0)])
    np.testing.assert_allclose(found, np.full(4, np.log(0.25)))


def test_the_words_of_any_object_have_probabilities_that_sum_to_one():
    for first in range(4):
        record = seen(MODEL, [certain(first)])
        after = [MODEL.after(record, viewed(*certain(word, 2))).log_likelihood for word in range(4)]
        np.testing.assert_allclose(np.exp(np.array(after) - record.log_likelihood).sum(axis=0), 1.0)
    assert len(PRIOR) == len(MODEL.class_names) - 1 + HIDDEN_NONE
