"""What the objects of a run that still goes on look like is what the bag of the whole run says."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.places import place_entries
from worlds.bags.vectors import LOOKS, looking, run

from semantic_slam.answers.appearance_history import AppearanceHistory
from semantic_slam.answers.appearances import appearances_of
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import Record

SETTINGS = SemanticModelConfiguration()


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return read_record(run(tmp_path_factory.mktemp("run"), looking(place_entries("ranges", 16))))


def test_after_every_keyframe_the_answer_is_that_of_a_bag_which_ends_there(record: Record) -> None:
    history = AppearanceHistory(SETTINGS)
    for number, belief in enumerate(record.beliefs, start=1):
        history.add(belief, record.measurements[belief.stamp_ns])
        if number % 5:
            continue
        whole = appearances_of(record.beliefs[:number], record.measurements, SETTINGS)
        for vector in LOOKS:
            live, recorded = (
                find_objects(belief, Question(vector=vector), looks) for looks in (history.appearances(), whole)
            )
            assert [own.object_id for own in live.objects] == [own.object_id for own in recorded.objects]
            assert live.unknown == recorded.unknown < 0.5


def test_nothing_is_kept_of_keyframes_before_the_first_vector(record: Record) -> None:
    history, first = AppearanceHistory(SETTINGS), record.beliefs[:4]
    for belief in first:
        told = record.measurements[belief.stamp_ns]
        history.add(belief, replace(told, embeddings=np.full((len(told), 300), np.nan)))
    with pytest.raises(InputError, match=r"no detection of this run has a vector.*embeddings"):
        history.appearances()
    for belief in record.beliefs[4:]:
        history.add(belief, record.measurements[belief.stamp_ns])
    late = appearances_of(record.beliefs[4:], record.measurements, SETTINGS)
    assert set(history.appearances().records) == set(late.records)
    np.testing.assert_array_equal(history.appearances().background.centre, late.background.centre)


def test_an_answer_is_built_once_for_a_keyframe(record: Record) -> None:
    history = AppearanceHistory(SETTINGS)
    for belief in record.beliefs[:8]:
        history.add(belief, record.measurements[belief.stamp_ns])
    once = history.appearances()
    assert history.appearances() is once
    history.add(record.beliefs[8], record.measurements[record.beliefs[8].stamp_ns])
    assert history.appearances() is not once


def test_a_history_that_lacks_the_first_keyframes_says_so(record: Record) -> None:
    history = AppearanceHistory(SETTINGS)
    for belief in record.beliefs[6:]:
        history.add(belief, record.measurements[belief.stamp_ns])
    with pytest.raises(InputError, match=r"before keyframe 6 are not known.*restarted"):
        history.appearances()


def test_of_older_keyframes_than_the_window_a_view_from_each_side_is_kept(record: Record) -> None:
    """The objects stand still and nothing is revised: the answers are those of the whole run."""
    history = AppearanceHistory(SETTINGS, window=6, chunk=2)
    for number, belief in enumerate(record.beliefs, start=1):
        history.add(belief, record.measurements[belief.stamp_ns])
        assert history.num_keyframes == (number if number < 8 else 6 + number % 2)
    looks, whole = history.appearances(), appearances_of(record.beliefs, record.measurements, SETTINGS)
    assert looks.records.keys() == whole.records.keys()
    for number, known in looks.records.items():
        assert known.num_views == whole.records[number].num_views
        assert len(known.vectors) == len(whole.records[number].vectors)
    assert looks.seen.count == whole.seen.count
    for vector in LOOKS:
        live, recorded = (find_objects(record.beliefs[-1], Question(vector=vector), own) for own in (looks, whole))
        assert [own.object_id for own in live.objects] == [own.object_id for own in recorded.objects]
        assert live.objects[0].probability == pytest.approx(recorded.objects[0].probability, abs=0.02)


def test_vectors_of_another_network_in_older_keyframes_end_no_run_and_are_named(record: Record) -> None:
    history = AppearanceHistory(SETTINGS, window=2, chunk=2)
    for number, belief in enumerate(record.beliefs):
        told = record.measurements[belief.stamp_ns]
        vectors = told.embeddings if number < 7 else told.embeddings[:, :200]
        history.add(belief, replace(told, embeddings=vectors))
    with pytest.raises(InputError, match=r"embeddings of \[200, 300\] components are mixed"):
        history.appearances()


def test_older_keyframes_without_an_object_are_forgotten(record: Record) -> None:
    history = AppearanceHistory(SETTINGS, window=2, chunk=2)
    for number, belief in enumerate(record.beliefs):
        seen = belief if number > 5 else replace(belief, associations=np.full_like(belief.associations, -1))
        history.add(seen, record.measurements[belief.stamp_ns])
    assert len(history.appearances().records) == 2
