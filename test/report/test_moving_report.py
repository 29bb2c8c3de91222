"""What a report says of objects that move, and what it hands to the next run."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, OBJECT_CLASSES, OBJECTS, small_belief, write_belief_bag

from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.report.comparison import Run
from semantic_slam.report.document import Analysis, analyse, map_prior, object_rows
from semantic_slam.report.page import render_page
from semantic_slam.report.shown.objects import object_views
from semantic_slam.report.shown.scene import scene
from semantic_slam.report.verdict import verdict

COLOURS = ["#000"] * len(CLASSES)


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    beliefs, _ = write_belief_bag(tmp_path_factory.mktemp("moving"), 8)
    return analyse(read_record(beliefs), beliefs, "0" * 64)


@pytest.fixture(scope="module")
def moving(still: Analysis) -> Analysis:
    """The second object moves at 1 m/s along x."""
    record, probabilities, velocities = still.record, np.full(len(OBJECTS), 0.01), np.zeros((len(OBJECTS), 6))
    probabilities[1], velocities[1, 0] = 0.97, 1.0
    last = replace(record.beliefs[-1], moving=probabilities, object_velocities=velocities)
    return replace(still, record=replace(record, beliefs=(*record.beliefs[:-1], last)))


def with_last(analysis: Analysis, **changes: np.ndarray) -> Analysis:
    """The analysis with other values in its last belief."""
    record = analysis.record
    last = replace(record.beliefs[-1], **changes)
    return replace(analysis, record=replace(record, beliefs=(*record.beliefs[:-1], last)))


def test_what_moves_is_drawn_and_listed(moving: Analysis) -> None:
    assert scene(moving, COLOURS)["frames"][-1]["m"] == [[1, 1.0, 0.0]]
    assert '<td data-name="Moves" class="num">97' in render_page([Run("moving", moving)], None)
    rows = object_rows(moving)
    assert rows[1]["moving"] == 0.97 and rows[1]["velocity"].tolist() == [1.0, 0.0, 0.0]


def test_where_nothing_may_move_nothing_is_said_of_it(still: Analysis) -> None:
    assert "Moves" not in render_page([Run("still", still)], None)
    assert not any("m" in frame for frame in scene(still, COLOURS)["frames"])


def test_what_moves_is_not_handed_to_the_next_run(still: Analysis, moving: Analysis) -> None:
    known = [own.object_id for own in map_prior(still.record).objects]
    gone = int(moving.record.beliefs[-1].object_ids[1])
    assert [own.object_id for own in map_prior(moving.record).objects] == [n for n in known if n != gone]


def test_what_moves_has_no_error_from_where_it_once_was(still: Analysis, moving: Analysis) -> None:
    before, after = object_views(still, COLOURS), object_views(moving, COLOURS)
    assert all(np.isfinite(view.error_m) for view in before)
    assert [np.isnan(view.error_m) for view in after] == [row == 1 for row in range(len(after))]


def test_what_may_not_exist_is_counted_apart(still: Analysis) -> None:
    existence = np.ones(len(OBJECTS))
    existence[0] = 0.02
    doubtful = with_last(still, existence=existence)
    said = verdict(doubtful, object_views(doubtful, COLOURS))
    assert any(f"{len(OBJECTS) - 1} objects are on the map, besides 1 that may not exist" in words for words in said)


def test_what_may_not_exist_is_not_named_as_ambiguous(still: Analysis) -> None:
    """Whether it exists is asked before what it is; all classes are open here."""
    existence, open_classes = np.ones(len(OBJECTS)), np.full((len(OBJECTS), len(CLASSES)), 1.0 / len(CLASSES))
    existence[1:6] = 0.004
    analysis = with_last(still, existence=existence, class_probabilities=open_classes)
    said = " ".join(verdict(analysis, object_views(analysis, COLOURS)))
    assert "2 objects are on the map, besides 5 that may not exist; the class of none is known" in said
    assert [f"Object {n} is ambiguous" in said for n in range(1, 8)] == [n in (1, 7) for n in range(1, 8)]
    assert "more are ambiguous" not in said


def test_a_class_that_is_surely_wrong_is_said_where_the_truth_is_known(still: Analysis) -> None:
    """The first object is a crate, the third a chest; both are taken for desks, the third without certainty."""
    rows = 0.97 * np.eye(len(CLASSES))[list(OBJECT_CLASSES)] + 0.01
    rows[0], rows[2] = [0.01, 0.01, 0.98], [0.06, 0.2, 0.74]
    wrong = with_last(still, class_probabilities=rows)
    said = verdict(wrong, object_views(wrong, COLOURS))
    assert "One class held for known is wrong: that of object 1 is crate, not desk." in said
    assert any("the classes of 6 of them are known with at least 95 % certainty" in words for words in said)
    blind = replace(wrong, evaluation=None)
    assert not any("is wrong" in words for words in verdict(blind, object_views(blind, COLOURS)))


def test_an_object_of_which_nothing_is_known_is_of_no_most_likely_class(still: Analysis) -> None:
    """All classes are equally likely."""
    open_classes = np.full((len(OBJECTS), len(CLASSES)), 1.0 / len(CLASSES))
    unknown = with_last(still, class_probabilities=open_classes)
    assert {view.class_name for view in object_views(unknown, COLOURS)} == {""}
    page = render_page([Run("unknown", unknown)], None)
    assert page.count('<td data-name="Most likely">–</td>') == len(OBJECTS) and "≠" not in page


def test_a_guess_at_what_was_never_seen_is_not_marked_as_wrong(still: Analysis) -> None:
    """All are taken for chests with little certainty, which five of them are not."""
    guessed = with_last(still, class_probabilities=np.tile([0.2, 0.5, 0.3], (len(OBJECTS), 1)))
    seen, unseen = guessed, replace(guessed, detection_counts=Counter())
    assert [render_page([Run("drive", own)], None).count("≠") for own in (seen, unseen)] == [5, 0]


@pytest.mark.parametrize(
    ("entropy", "said"),
    [(0.0, "the 2 hypotheses at the end associate alike and differ in classes or modes."), (0.01, "")],
)
def test_hypotheses_beside_one_explanation_are_accounted_for(still: Analysis, entropy: float, said: str) -> None:
    belief = small_belief(0, [1, 2], [0, 0], [0.7, 0.3], [1], [[0], [0]])
    record = replace(still.record, beliefs=(replace(belief, association_entropy=entropy),), truth=None)
    analysis = analyse(record, Path("beliefs"), "0" * 64)
    words = next(own for own in verdict(analysis, object_views(analysis, COLOURS)) if "One explanation" in own)
    assert ("hypotheses at the end" in words) == bool(said) and words.endswith(said)


@pytest.mark.parametrize(("settled", "said"), [(3, "certain from keyframe 3 on."), (None, "never certain for good.")])
def test_the_head_says_since_when_the_true_assignment_was_certain(
    still: Analysis, settled: int | None, said: str
) -> None:
    assert still.evaluation is not None
    metrics = {**still.evaluation.metrics, "keyframe_disambiguated": settled}
    analysis = replace(still, evaluation=replace(still.evaluation, metrics=metrics))
    words = verdict(analysis, object_views(analysis, COLOURS))
    assert any(own.endswith(f"the true assignment was {said}") for own in words)


def test_what_less_likely_explanations_alone_have_seen_is_told_from_what_none_has(still: Analysis) -> None:
    belief = small_belief(0, [1, 2], [0, 0], [0.7, 0.3], [0, 1, 2], [[0], [1]])
    record = replace(still.record, beliefs=(belief,), truth=None)
    analysis = analyse(record, Path("beliefs"), "0" * 64)
    said = verdict(analysis, object_views(analysis, COLOURS))
    assert "One object was never seen." in said
    assert "One object is of less likely explanations alone." in said
