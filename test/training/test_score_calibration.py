"""What a detector's scores are worth is learned from runs: of one that is surer than right, and of a modest one."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.evaluation.classification import expected_calibration_error
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.training.labels import candidates
from semantic_slam.training.labels.candidates import alike, by_score
from semantic_slam.training.labels.fit import as_they_are
from semantic_slam.training.labels.maximisation import BeforeFit
from semantic_slam.training.labels.passes import FOLDS, STRETCHES
from semantic_slam.training.labels.report import scores_line
from semantic_slam.training.labels.tracks import Track
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, Confusion
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord
from semantic_slam.viewpoint.labels.settings import LabelSettings

LABELS = ("chair", "cup", "sofa", "tv")
SPREAD = 1.1
"""Standard deviation of the features, about a unit vector of what a box shows; its probabilities are exact."""
BEFORE = BeforeFit(num_labels=4, accuracy=0.75, counts=4.0, outlier_share=0.05)
START = LabelModel(
    labels=LABELS,
    settings=LabelSettings.grid((0.0, 0.5), (0.5,), (1.0, 10.0)),
    confusions=(BEFORE.confusion(),),
    class_shares=np.full(5, 0.2),
)


def told(shown: Array, power: float, random: np.random.Generator) -> list[LabelWord]:
    """Scores for boxes that show (N,) words, to a power of what they would be if they were probabilities."""
    features = np.eye(5)[shown] + random.normal(0.0, SPREAD, (len(shown), 5))
    scores = np.exp(power * (features - features.max(axis=1, keepdims=True)) / SPREAD**2)
    scores /= scores.sum(axis=1, keepdims=True)
    return [LabelWord(answer=int(own.argmax()), shares=own) for own in scores]


def tracks(power: float, seed: int, objects: int, views: int) -> list[Track]:
    """Objects of each class in turn, around which a robot drives."""
    random, found = np.random.default_rng(seed), []
    for number in range(objects):
        words = told(np.full(views, number % len(LABELS)), power, random)
        cells = (random.integers(DIRECTIONS) + np.arange(views) * DIRECTIONS // views) % DIRECTIONS
        own = [
            LabelView(word=word, direction=int(cell), log_range=0.0) for word, cell in zip(words, cells, strict=True)
        ]
        stretches = tuple((np.arange(views) * STRETCHES // views).tolist())
        found.append(Track(object_id=number, views=tuple(own), stretches=stretches, weight=1.0, log_prior=None))
    return found


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 2.0])
def test_of_one_box_the_probabilities_are_the_power_of_its_scores(power: float) -> None:
    """Of a detector that confuses nothing; 0: its answer is right."""
    word = LabelWord(answer=1, shares=np.array([0.2, 0.6, 0.1, 0.06, 0.04]))
    model = LabelModel(
        labels=LABELS,
        settings=LabelSettings.grid((0.0,), (0.5,), (1.0,), score_powers=(power,)),
        confusions=(Confusion.symmetric(4, 1.0 - 1e-9, 1.0, 0.0),),
        class_shares=np.full(5, 0.2),
    )
    record = model.after(model.start(), LabelView(word=word, direction=0, log_range=0.0))
    likelihood = np.exp(model.class_log_likelihood(record))
    raised = word.shares**power if power else np.eye(5)[1]
    np.testing.assert_allclose((likelihood / likelihood[:4].sum())[:4], raised[:4] / raised[:4].sum(), atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("power", [3.0, 0.4])
def test_probabilities_of_classes_are_calibrated_after_the_fit(power: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a detector whose scores are that power of probabilities: the inverse is found, and new objects are known.

    Against the exact posterior, which knows that power and that nothing is confused.
    """
    for name, values in (("REPEAT_SHARES", (0.0,)), ("REPEAT_RADS", (0.5,)), ("COUNT_FACTORS", (30.0,))):
        monkeypatch.setattr(candidates, name, values)
    drives = tracks(power, 1, objects=24, views=15)
    same = alike(START, BEFORE, drives)
    found = by_score(same, BEFORE, drives)
    assert found.held_out > max(same.held_out, as_they_are([START] * len(FOLDS), drives).held_out) + 3.0
    whole = found.whole
    likeliest = whole.model.settings.score_powers[np.argmax(whole.weights)]
    assert abs(np.log(likeliest * power)) < 0.5
    fitted = replace(whole.model, settings=whole.model.settings.weighted(np.log(whole.weights)))
    others = tracks(power, 2, objects=800, views=2)
    raised = np.array(
        [np.prod([view.word.shares for view in own.views], axis=0)[:4] ** (1.0 / power) for own in others]
    )
    exact = judged(raised / raised.sum(axis=1, keepdims=True))
    before, after = (judged(np.array([posterior(model, own) for own in others])) for model in (START, fitted))
    assert after[0] - exact[0] < 0.3 * (before[0] - exact[0])
    assert after[1] < 0.8 * before[1] and after[1] < exact[1] + 0.05


def posterior(model: LabelModel, own: Track) -> Array:
    """(C,) probabilities of the classes of one object."""
    record = model.start()
    for view in own.views:
        record = model.after(record, view)
    logs = model.class_log_likelihood(record) + np.log(model.class_shares)
    return np.asarray(np.exp(logs - finite_log_sum_exp(logs)))


def judged(probabilities: Array) -> tuple[float, float]:
    """Mean negative log probability of the true classes in nats, and the expected calibration error."""
    true = np.arange(len(probabilities)) % len(LABELS)
    misses = -np.log(probabilities[np.arange(len(true)), true])
    return float(misses.mean()), expected_calibration_error(probabilities, true)


@pytest.mark.parametrize(
    ("power", "is_farthest"), [(0.25, True), (0.5, False), (1.0, False), (2.0, False), (4.0, True)]
)
def test_a_power_of_scores_at_an_end_of_what_was_tried_is_told(power: float, is_farthest: bool) -> None:
    assert ("the farthest that was tried" in scores_line(power)) == is_farthest
