"""A detector is one for all objects: their words together tell how it is set, and that tells of each object's name."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.class_models.detector import load_label_model
from semantic_slam.configuration import Configuration
from semantic_slam.contracts.semantics import Weighed, WitnessSemantics
from semantic_slam.errors import InputError
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.inference.building import initial_pose_of, make_run_configuration, problem_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.semantics.detector.detector_labels import DetectorLabels

PLACES = {"a": (3.0, -1.0), "b": (3.0, 1.0), "c": (4.0, 0.0)}
WORDS = (
    {"a": "chair", "b": "cup"},
    {"a": "chair", "b": "cup", "c": "tv"},
    {"a": "cup", "b": "cup", "c": "tv"},
    {"b": "chair"},
    {"a": "chair", "c": "tv"},
)
SETTINGS = {"kind": "detector", "labels": ["chair", "cup", "tv"]}


@pytest.fixture(scope="module")
def weighed() -> list[Weighed]:
    """What was said of each keyframe of a robot that drives past three objects, whose identities are given."""
    own = Configuration.of(association="given", semantic_model=SETTINGS)
    pose, covariance = initial_pose_of(own)
    problem = problem_of(make_run_configuration(own, None, pose, covariance, stamp_ns=0))
    witness = WitnessSemantics(problem.semantics)
    watched = replace(problem, semantics=witness)
    engine = Engine.of_run(
        make_run_configuration(own, None, pose, covariance, stamp_ns=0), InProcessPool(1, watched), watched
    )
    for index, words in enumerate(WORDS):
        seen = [
            Detection.at(PLACES[name][0] - 0.3 * index, PLACES[name][1], label=word, track_id=name, score=0.7)
            for name, word in words.items()
        ]
        engine.process(Keyframe.planar(index, motion=(0.3 if index else 0.0, 0.0, 0.0), detections=seen))
    return [asked[0] for asked in witness.asked]


def test_evidence_is_the_mean_over_settings_of_the_product_over_objects(weighed):
    told = [views.recent[0] for views in weighed[-1].records[0].values()]
    assert len(told) == len(PLACES)
    together = np.sum([own.log_evidence for own in told], axis=0)
    exact = log_sum_exp(together) - np.log(len(together))
    assert sum(float(own.evidence.log_weights[0]) for own in weighed) == pytest.approx(exact, abs=1e-9)


def test_a_name_is_inferred_under_the_setting_that_all_objects_tell(weighed):
    records = weighed[-1].records[0]
    even = np.full(4, -np.log(4.0))
    for number, views in records.items():
        others = np.sum([own.recent[0].log_evidence for n, own in records.items() if n != number], axis=0)
        told = np.log(views.recent[0].shares) + views.recent[0].log_greatest
        prior = even + views.recent[0].log_ratios  # by the classes of those that were there
        joint = log_sum_exp(others[:, None] + prior + told, axis=0)
        exact = np.exp(joint - log_sum_exp(joint))
        found = np.exp(even + views.log_likelihood - log_sum_exp(even + views.log_likelihood))
        np.testing.assert_allclose(found, exact, atol=1e-12)


def test_what_a_map_says_no_class_of_is_as_likely_of_each_as_what_is_new(weighed):
    """Beside objects that are called something; an object that a map does name keeps what the map says."""
    given, records = weighed[-1].given, weighed[-1].records[0]
    even = np.full(4, -np.log(4.0))
    named = np.log([0.7, 0.1, 0.1, 0.1])
    model = load_label_model(Configuration.of(semantic_model=SETTINGS).semantic_model)
    assert model is not None
    semantics = DetectorLabels(model, class_counts=1.0)
    nothing = np.zeros((len(given.step.detections), 3))
    untold, mapped, new = semantics.log_pairs(
        given.step, records, [98, 99], np.array([even, named, even]), nothing, nothing
    ).T
    np.testing.assert_array_equal(untold, new)
    assert (mapped != new).all()
    alone = semantics.log_pairs(given.step, {}, [98, 99], np.array([even, named, even]), nothing, nothing)
    np.testing.assert_array_equal(alone[:, 1], mapped)
    assert (alone[:, 2] != new).all()


def test_every_combination_is_a_setting():
    own = Configuration.of(semantic_model=SETTINGS).semantic_model
    model = load_label_model(own)
    assert model is not None
    assert model.num_settings == 2 * len(own.repeat_shares) * len(own.count_factors)
    broad = load_label_model(replace(own, score_powers=(0.0, 0.5, 1.0, 2.0)))
    assert broad is not None and broad.num_settings == 2 * model.num_settings and broad.powers == (0.0, 0.5, 1.0, 2.0)
    for powers in ((), (1.0, -0.5)):
        with pytest.raises(InputError, match="score_powers must not be below 0, one at least"):
            load_label_model(replace(own, score_powers=powers))
