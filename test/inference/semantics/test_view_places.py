"""Viewpoints on objects are those of the camera, wherever it is on the robot."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.class_models.detector import load_label_model
from semantic_slam.configuration import Configuration
from semantic_slam.contracts.semantics import WitnessSemantics
from semantic_slam.geometry import se2
from semantic_slam.inference.building import initial_pose_of, make_run_configuration, problem_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.planar.frames import camera_bearing, camera_distance, object_in_body
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, STEP_RAD
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord

OBJECT = np.array([4.0, 0.5])
CAMERA = np.array([1.5, 0.2, 0.9])
"""In the body frame: far ahead, as on a forklift."""
POSES = np.array([[0.0, 0.0, 0.0], [1.8, 0.1, 0.3]])
LABELS = ["chair", "cup", "tv"]


def keyframe(index: int) -> Keyframe:
    """The object is called a chair, at its true place."""
    before, pose = POSES[max(index - 1, 0)], POSES[index]
    ahead, left = object_in_body(pose, OBJECT).tolist()
    seen = Detection.at(ahead, left, label="chair", track_id="object")
    own = Keyframe.planar(index, motion=se2.between(before, pose), detections=[seen])
    return replace(own, measurements=replace(own.measurements, sensor_position=CAMERA))


@pytest.fixture(scope="module")
def told() -> ObjectViews:
    """Records of the object after both keyframes."""
    own = Configuration.of(association="given", semantic_model={"kind": "detector", "labels": LABELS})
    run = make_run_configuration(own, None, *initial_pose_of(own), stamp_ns=0)
    problem = problem_of(run)
    witness = WitnessSemantics(problem.semantics)
    watched = replace(problem, semantics=witness)
    engine = Engine.of_run(run, InProcessPool(1, watched), watched)
    for index in range(len(POSES)):
        engine.process(keyframe(index))
    (views,) = witness.asked[-1][0].records[0].values()
    return views


def cameras() -> np.ndarray:
    """(2, 2) positions of the camera relative to the object, in map."""
    sin, cos = np.sin(POSES[:, 2]), np.cos(POSES[:, 2])
    x, y, _ = CAMERA
    return POSES[:, :2] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=1) - OBJECT


def views() -> list[LabelView]:
    word = LabelWord(answer=0, shares=np.array([1.0, 0.0, 0.0, 0.0]))
    places = np.rint(np.array([np.arctan2(*cameras().T[::-1]), np.log(np.hypot(*cameras().T))]).T / STEP_RAD)
    return [LabelView(word=word, direction=int(d) % DIRECTIONS, log_range=STEP_RAD * r) for d, r in places]


def test_bearings_and_distances_are_the_cameras():
    seen = POSES, np.tile(OBJECT, (2, 1)), CAMERA[:2]
    np.testing.assert_allclose(camera_distance(*seen), np.hypot(*cameras().T), rtol=1e-14)
    np.testing.assert_allclose(camera_bearing(*seen), np.arctan2(*cameras().T[::-1]), rtol=1e-14)
    unmoved = camera_distance(POSES, seen[1], np.zeros(2))
    np.testing.assert_array_equal(unmoved, np.hypot(*(OBJECT - POSES[:, :2]).T))


def test_a_label_counts_as_a_view_from_where_the_camera_is(told):
    newest = told.recent[0].record.newest
    places = sorted(zip(newest.directions.tolist(), newest.log_ranges.tolist(), strict=True))
    assert places == sorted((view.direction, view.log_range) for view in views())


def test_labels_are_as_sure_as_the_camera_has_moved(told):
    model = load_label_model(Configuration.of(semantic_model={"kind": "detector", "labels": LABELS}).semantic_model)
    assert model is not None
    record = model.start()
    for view in views():
        record = model.after(record, view)
    by_word = model.settings.score_powers == 0.0
    found = told.recent[0].record.log_likelihood
    np.testing.assert_allclose(found[by_word], record.log_likelihood[by_word], atol=1e-12)
