"""Fitted confusions: what they say of words, by side and stretch, whatever the vocabulary, through a file and back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaln

from semantic_slam.errors import InputError
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, Confusion
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import ANY_STRETCH, LabelView, LabelWord
from semantic_slam.viewpoint.labels.runner_up import EVEN_HABITS
from semantic_slam.viewpoint.labels.settings import LabelSettings
from semantic_slam.viewpoint.labels.store import FORMAT, FittedBag, FittedLabels, read_labels, save_labels
from semantic_slam.viewpoint.labels.vocabulary import with_vocabulary

LABELS = ("cup", "tv")
RANDOM = np.random.default_rng(3)
SIDES = 4
ALIKE, OTHER, SIDED = (
    Confusion(
        counts=RANDOM.uniform(0.5, 5.0, (sides, 2, 3)), none=RANDOM.uniform(0.5, 2.0, (2, 3)), outlier_share=share
    )
    for sides, share in ((1, 0.0), (1, 0.1), (SIDES, 0.0))
)
ONE = LabelSettings.grid((0.0,), (0.5,), (1.0,))
SHARES = np.array([0.5, 0.3, 0.2])


def model(*confusions: Confusion, settings: LabelSettings = ONE, edges: tuple[int, ...] = ()) -> LabelModel:
    return LabelModel(
        labels=LABELS, settings=settings, confusions=confusions, class_shares=SHARES, stretch_edges_ns=edges
    )


def view(word: int, direction: int = 0, stretch: int = ANY_STRETCH) -> LabelView:
    return LabelView(
        word=LabelWord(answer=word, shares=np.eye(3)[word]), direction=direction, log_range=0.0, stretch=stretch
    )


def told(of: LabelModel, views: list[LabelView]) -> np.ndarray:
    record = of.start()
    for own in views:
        record = of.after(record, own)
    return of.by_setting(record)


def test_words_count_as_the_dirichlet_integral_of_the_fitted_counts_has_it():
    words = [0, 2, 0, 1, 0]
    counts = np.bincount(words, minlength=3)
    found = told(model(ALIKE), [view(word) for word in words])[0]
    for row, prior in enumerate(ALIKE.counts[0]):
        after = prior + counts
        exact = gammaln(after).sum() - gammaln(after.sum()) - gammaln(prior).sum() + gammaln(prior.sum())
        assert found[row] == pytest.approx(exact)


def test_headings_are_summed_over():
    """With confusions that are certain: the mean over headings of the product over views."""
    sure = replace(SIDED, counts=1e9 * SIDED.counts)
    views = [(0, 3), (1, 20), (0, 40), (2, 71)]
    found = told(model(sure), [view(*own) for own in views])[0]
    theta = SIDED.counts / SIDED.counts.sum(axis=2, keepdims=True)
    for row in range(len(LABELS)):
        by_heading = [
            np.prod(
                [theta[(direction * SIDES // DIRECTIONS - heading) % SIDES, row, word] for word, direction in views]
            )
            for heading in range(SIDES)
        ]
        assert found[row] == pytest.approx(np.log(np.mean(by_heading)), abs=1e-6)


def test_classes_whose_sides_are_alike_need_one_heading():
    counts = SIDED.counts.copy()
    counts[:, 1] = counts[0, 1]
    lean = model(replace(SIDED, counts=counts))
    whole = replace(lean, is_lean=False)
    assert lean.headings.tolist() == [SIDES, 1]
    views = [view(*own) for own in [(0, 3), (1, 20), (0, 40), (2, 71)]]
    np.testing.assert_allclose(told(lean, views), told(whole, views))


def test_an_object_that_is_turned_by_a_side_is_as_likely():
    views = [(0, 3), (1, 20), (0, 40)]
    turned = [(word, (direction + DIRECTIONS // SIDES) % DIRECTIONS) for word, direction in views]
    first, second = (told(model(SIDED), [view(*own) for own in seen]) for seen in (views, turned))
    np.testing.assert_allclose(first, second)


def test_what_may_come_next_sums_to_one_and_is_what_is_weighed():
    of = model(OTHER, settings=LabelSettings.grid((0.0, 0.9), (0.5,), (1.0, 10.0)))
    record = of.after(of.after(of.start(), view(0)), view(1, 9))
    next_words = of.word_probabilities(record, view(0, 12))
    np.testing.assert_allclose(next_words.sum(axis=2), 1.0)
    for word in range(3):
        gained = of.after(record, view(word, 12)).log_likelihood - record.log_likelihood
        by_word = of.settings.score_powers == 0.0
        np.testing.assert_allclose(np.exp(gained[by_word]), next_words[by_word, :, word])


def test_every_stretch_of_a_known_bag_has_the_model_that_was_fitted_without_it():
    of = model(ALIKE, OTHER, edges=(10, 20))
    assert [of.stretch_of(stamp) for stamp in (9, 10, 20, 21)] == [ANY_STRETCH, 0, 0, ANY_STRETCH]
    within, elsewhere = (told(of, [view(0, 0, stretch), view(1, 9, stretch)]) for stretch in (0, ANY_STRETCH))
    plain = [view(0), view(1, 9)]
    np.testing.assert_array_equal(within, told(model(ALIKE), plain))
    np.testing.assert_array_equal(elsewhere, told(model(OTHER), plain))


def test_other_labels_keep_what_was_learned_of_those_that_are_known():
    of = with_vocabulary(model(ALIKE), ("bed", "tv"))
    assert of.class_names[:2] == ("bed", "tv")
    np.testing.assert_allclose(of.class_shares, np.array([0.3, 0.3, 0.2]) / 0.8)
    cup, tv, other = ALIKE.counts[0, 1]  # of the class tv: cup is another word now, and half of these were beds
    np.testing.assert_allclose(of.confusions[0].counts[0, 1], [0.5 * other, tv, cup + 0.5 * other])


FITTED = FittedLabels(
    labels=LABELS,
    settings=LabelSettings.grid((0.0, 0.5), (0.5,), (1.0,), 1.0),
    confusions=(ALIKE, OTHER),
    class_shares=SHARES,
    bags=(
        FittedBag(
            path="bag",
            sha256="ab",
            stretch_edges_ns=(10, 20),
            log_settings=(0.0, -1.0, 0.0, 0.0),
            class_shares=(0.2, 0.2, 0.6),
            habits=tuple((EVEN_HABITS + np.linspace(0.01, -0.01, len(EVEN_HABITS))).tolist()),
        ),
    ),
    report={"rounds": 2},
    habits=EVEN_HABITS + np.linspace(-0.02, 0.02, len(EVEN_HABITS)),
)


def test_a_file_gives_back_what_was_written(tmp_path):
    save_labels(FITTED, tmp_path / "fitted.safetensors")
    found = read_labels(tmp_path / "fitted.safetensors")
    assert (found.labels, found.bags, found.report) == (FITTED.labels, FITTED.bags, FITTED.report)
    for own, other in zip(found.confusions, FITTED.confusions, strict=True):
        np.testing.assert_array_equal(own.counts, other.counts)
    known, unknown = found.model("ab"), found.model("cd")
    assert (len(known.confusions), len(unknown.confusions)) == (2, 1)
    np.testing.assert_allclose(known.class_shares, [0.2, 0.2, 0.6])
    np.testing.assert_allclose(known.habits, FITTED.bags[0].habits)
    np.testing.assert_allclose(unknown.habits, FITTED.habits)
    assert known.settings.log_weights[1] < known.settings.log_weights[0]
    np.testing.assert_allclose(unknown.settings.log_weights, -np.log(4.0))


def test_a_file_from_before_scores_were_calibrated_says_whether_they_count(tmp_path):
    path = tmp_path / "fitted.safetensors"
    save_labels(FITTED, path)
    arrays, described = FORMAT.read(path)
    arrays["settings.by_score"] = arrays.pop("settings.score_powers")
    FORMAT.write(path, arrays, described)
    np.testing.assert_array_equal(read_labels(path).settings.score_powers, FITTED.settings.score_powers)


def test_a_file_of_something_else_is_refused_in_one_line(tmp_path):
    path = tmp_path / "fitted.safetensors"
    path.write_bytes(b"not a file of models")
    with pytest.raises(InputError, match="not readable as safetensors"):
        read_labels(path)
    below = replace(FITTED.settings, score_powers=np.array([0.0, 0.0, 1.0, -1.0]))
    faults = (
        {"class_shares": SHARES[:2]},
        {"habits": EVEN_HABITS[1:]},
        {"habits": 0.0 * EVEN_HABITS},
        {"settings": below},
    )
    for wrong in faults:
        save_labels(replace(FITTED, **wrong), path)
        with pytest.raises(InputError, match="fit it anew with semantic_slam fit --from-run"):
            read_labels(path)
