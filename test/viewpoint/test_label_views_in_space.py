"""A detector repeats its answers from nearly the same direction in space: by azimuth and elevation."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.class_models.detector import load_label_model
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, STEP_RAD, turns_in_space
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord

LABELS = ["chair", "cup", "tv"]
LOOKS_DOWN = (0.0, 0.0, 0.0, 0.70710678, -0.70710678, 0.0, 0.0)
"""Optical frame of a camera below the body: z down, x to the right."""
OBJECT = np.array([0.03, 0.02, 0.0])
ABOVE = np.array([[0.3, 0.0, 2.5], [-0.3, 0.0, 2.5], [0.0, 0.3, 2.5], [0.0, -0.3, 2.5], [0.2, 0.2, 2.5]])
"""Positions of a robot that hovers over the object."""
CHAIR = LabelWord(answer=0, shares=np.eye(4)[0])


def label_model() -> LabelModel:
    model = load_label_model(Configuration.of(semantic_model={"kind": "detector", "labels": LABELS}).semantic_model)
    assert model is not None
    return model


def likelihood(
    model: LabelModel, places: list[tuple[int, int]], log_range: float = 0.0, word: LabelWord = CHAIR
) -> np.ndarray:
    """(C,) of one label seen from cells of azimuth and elevation."""
    record = model.start()
    for azimuth, elevation in places:
        view = LabelView(word=word, direction=azimuth % DIRECTIONS, elevation=elevation, log_range=log_range)
        record = model.after(record, view)
    return model.class_log_likelihood(record)


def test_angles_between_directions_are_those_of_their_unit_vectors() -> None:
    random = np.random.default_rng(2)
    around, up = random.integers(0, DIRECTIONS, 200), random.integers(-18, 19, 200)
    azimuth, elevation = STEP_RAD * around, STEP_RAD * up
    level = np.cos(elevation)
    unit = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
    for number in range(20):
        expected = np.arccos(np.clip(unit @ unit[number], -1.0, 1.0))
        found = turns_in_space(around - around[number], up, int(up[number]))
        np.testing.assert_allclose(found, expected, atol=1e-7)


@pytest.mark.parametrize("places", [[(0, 15), (36, 15), (0, 18)], [(9, -3), (9, 3), (9, 0)]])
def test_views_over_the_top_count_as_those_around_the_side(places: list[tuple[int, int]]) -> None:
    """Rotated as a whole, the same views say the same of the class."""
    np.testing.assert_allclose(likelihood(label_model(), places), likelihood(label_model(), [(0, 0), (6, 0), (3, 0)]))


def test_a_robot_that_hovers_over_an_object_hears_much_the_same() -> None:
    """Class probabilities are those of the label model from directions within 10 degrees of straight above."""
    configuration = Configuration.of(
        state_space="spatial",
        observation="points",
        association="given",
        semantic_model={"kind": "detector", "labels": LABELS, "label_accuracy": 0.6},
        open_world={"iterate_updates": True},
    )
    engine = Engine(configuration, initial_pose=(*ABOVE[0], 0, 0, 0, 1), initial_covariance=1e-8 * np.eye(6))
    for index, place in enumerate(ABOVE):
        motion = [*(place - ABOVE[max(index - 1, 0)]), 0.0, 0.0, 0.0, 1.0]
        seen = Detection.in_space(OBJECT - place, covariance=1e-6 * np.eye(3), label="chair", track_id="object")
        told = {"motion": motion, "motion_covariance": 1e-8 * np.eye(6)} if index else {}
        belief = engine.process(Keyframe.spatial(index, detections=[seen], T_body_camera=LOOKS_DOWN, **told))
    away = ABOVE - OBJECT
    cells = np.rint(np.arctan2([away[:, 1], away[:, 2]], [away[:, 0], np.hypot(*away[:, :2].T)]) / STEP_RAD).astype(int)
    model = load_label_model(configuration.semantic_model)
    assert model is not None
    places = list(zip(*cells.tolist(), strict=True))
    log_range = STEP_RAD * float(np.rint(np.log(2.5) / STEP_RAD))
    shares = WordReader(tuple(LABELS)).words(Keyframe.spatial(0, detections=[seen]).measurements).shares[0]
    expected = np.log(model.class_shares) + likelihood(model, places, log_range, LabelWord(answer=0, shares=shares))
    expected = np.exp(expected - np.logaddexp.reduce(expected))
    np.testing.assert_allclose(belief.class_probabilities[0], expected, atol=1e-6)
