"""Vectors that detections carry: through bags and pipeline to objects that are told apart and found by their looks."""

import numpy as np
import pytest
from worlds.bags.bag_factory import input_entries, of_topic
from worlds.bags.imported import read_bag
from worlds.bags.places import NUM_FRAMES, place_entries
from worlds.bags.vectors import LOOKS, SIZE, looking, run

from semantic_slam.answers.appearances import appearances_of
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.world.map_prior import read_map_prior
from semantic_slam.messages import topics
from semantic_slam.report.make import make_report


@pytest.mark.parametrize("entries", [place_entries("ranges"), input_entries(NUM_FRAMES)], ids=["places", "pictures"])
def test_objects_have_the_mean_directions_of_their_views(tmp_path, entries):
    last = read_bag(run(tmp_path, looking(entries)))["/hypothesis_manager/belief"][-1]
    there = last.existence > 0.5
    assert there.sum() == 2 and last.descriptors.shape[1] == 128 and last.class_names == ()
    cosine = np.corrcoef(last.descriptors[there])[0, 1]
    assert abs(cosine) < 0.9 and (last.descriptor_covariances[there] > 0.0).all()


def test_an_object_is_found_by_another_view_of_it_and_what_is_not_there_is_not(tmp_path):
    record = read_record(run(tmp_path, looking(place_entries("ranges", 16))))
    looks = appearances_of(record.beliefs, record.measurements, SemanticModelConfiguration())
    asked = LOOKS + np.random.default_rng(2).normal(0.0, 0.3, LOOKS.shape)
    best = [find_objects(record.beliefs[-1], Question(vector=vector), looks).objects[0] for vector in asked]
    assert min(found.probability for found in best) > 0.9
    assert len({found.object_id for found in best}) == 2
    strange = np.random.default_rng(3).normal(size=SIZE)
    assert find_objects(record.beliefs[-1], Question(vector=strange), looks).unknown > 0.5


def test_a_map_is_written_with_looks_and_taken_up_by_the_next_run(tmp_path):
    first = run(tmp_path / "first", looking(place_entries("ranges")))
    make_report(first, tmp_path / "report")
    prior = read_map_prior(tmp_path / "report" / "objects.json")
    assert prior.descriptor_space == "embedding-128" and len(prior.objects[0].descriptor) == 128
    again = run(tmp_path / "again", looking(place_entries("ranges")), prior, association="enumerated")
    last = read_bag(again)["/hypothesis_manager/belief"][-1]
    assert last.association_entropy < 0.1
    narrow = {"kind": "embedding", "embedding_dimensions": 64}
    with pytest.raises(InputError, match=r"latent space 'embedding-128'.*embedding_dimensions"):
        run(tmp_path / "other", looking(place_entries("ranges")), prior, semantic_model=narrow)


def test_vectors_of_two_lengths_are_an_error(tmp_path):
    entries = looking(place_entries("ranges", 12))
    looking(of_topic(entries, topics.DETECTIONS)[1:], looks=LOOKS[:, :9])
    with pytest.raises(InputError, match="9 components, before they had 300"):
        run(tmp_path, entries)


def test_detections_without_vectors_are_places_alone(tmp_path):
    last = read_bag(run(tmp_path, place_entries("ranges")))["/hypothesis_manager/belief"][-1]
    assert (last.existence > 0.5).sum() == 2 and np.isnan(last.descriptors).all()


def test_that_nothing_can_be_found_without_vectors_is_said(tmp_path):
    record = read_record(run(tmp_path, place_entries("ranges"), semantic_model={"kind": "none"}))
    with pytest.raises(InputError, match=r"no object of the map has a vector.*embeddings"):
        appearances_of(record.beliefs, record.measurements, SemanticModelConfiguration())
