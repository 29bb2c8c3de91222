"""Rooms without a map: the measures against cases by hand, what is done to a drive, and every method on a short one."""

import json
from dataclasses import replace

import numpy as np
import pytest
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.aliased_room import study as study
from semantic_slam_lab.studies.aliased_room.data import CLUTTER, Rates, Recording, alarms_per_frame, disturbed
from semantic_slam_lab.studies.aliased_room.metrics import gospa, matched
from semantic_slam_lab.studies.aliased_room.pages import claims_of
from semantic_slam_lab.studies.aliased_room.scores import score

from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import OdometryConfiguration, OpenWorldConfiguration, SemanticModelConfiguration
from semantic_slam.evaluation.trajectory import absolute_trajectory_error
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import planar_from_pose_vector, pose_vector_from_planar
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.open_world.merging import MergeCandidates, merge_copies
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.viewpoint.model import Viewpoints

CLASSES = ("crate", "locker", "crate")
OBJECTS = np.array([[2.5, 0.8, -2.8], [2.8, -0.9, 2.8], [4.2, 0.1, 3.1]])


@pytest.fixture(scope="module")
def model():
    return load_model(SemanticModelConfiguration())


def make_recording(model, num_keyframes: int = 12) -> Recording:
    """A robot sways before three objects, each of which looks as its class model says; no noise but the network's."""
    truth = np.array([[0.1 * k, 0.1 * np.sin(k), 0.1 * np.sin(0.7 * k)] for k in range(num_keyframes)])
    keyframes = tuple(
        Keyframe(
            index=k,
            stamp_ns=k + 1,
            odometry=pose_vector_from_planar(np.zeros(3)),
            odometry_covariance=np.eye(6),
            measurements=measured(model, k, pose),
        )
        for k, pose in enumerate(truth)
    )
    labels = (("1", "2", "3"),) * num_keyframes
    return Recording(7, keyframes, labels, truth, ("1", "2", "3"), CLASSES, OBJECTS)


def measured(model, k: int, robot: np.ndarray) -> SemanticMeasurements:
    count, size = len(OBJECTS), model.num_features
    relative = se2.between(np.broadcast_to(robot, OBJECTS.shape), OBJECTS)
    camera = se2.between(OBJECTS, np.broadcast_to(robot, OBJECTS.shape))
    views = Viewpoints(np.arctan2(camera[:, 1], camera[:, 0]), np.zeros(count), np.ones(count))
    numbers = np.array([model.class_names.index(name) for name in CLASSES])
    features = model.predict(numbers, views).mean
    return SemanticMeasurements(
        stamp_ns=k + 1,
        sequence=k,
        frame_id="base_link",
        class_names=model.class_names,
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.zeros((count, 4)),
        labels=("object",) * count,
        scores=np.ones(count),
        track_ids=("",) * count,
        class_probability_samples=features[:, None],
        features=features,
        feature_covariances=np.tile(0.01 * np.eye(size), (count, 1, 1)),
        predictive_entropy=np.zeros(count),
        mutual_information=np.zeros(count),
        ranges_m=np.hypot(relative[:, 0], relative[:, 1]),
        bearings_rad=np.arctan2(relative[:, 1], relative[:, 0]),
        geometric_covariances=np.tile(np.diag([0.1, 0.03]) ** 2, (count, 1, 1)),
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=bool),
    )


def test_gospa_by_hand() -> None:
    """c = 2: a pair 0.3 and 0.4 m off costs 0.25, a missing and a false object 2 each."""
    truth = np.array([[0.0, 0.0], [5.0, 0.0]])
    found = gospa(np.array([[0.3, 0.4], [9.0, 9.0]]), truth)
    assert found.localisation_m2 == pytest.approx(0.25)
    assert (found.missed_m2, found.false_m2) == (2.0, 2.0)
    assert found.total_m == pytest.approx(np.sqrt(4.25))
    assert gospa(truth[::-1], truth).total_m == 0.0
    assert gospa(np.zeros((0, 2)), truth).total_m == pytest.approx(2.0)
    assert gospa(truth, np.zeros((0, 2))).total_m == pytest.approx(2.0)


def test_gospa_chooses_the_best_pairs_and_never_pays_more_than_a_miss_and_a_false_one() -> None:
    """Truth at 0.0 and 0.9, estimates at 1.0 and 1.9.

    Straight pairs cost 1 + 1 = 2; the greedy pair of 0.01 leaves 1.9 and 0.0, whose 3.61 makes 3.62 in all. Beyond c a
    pair costs c^2 = 4, as a miss and a false one do.
    """
    truth, estimate = np.array([[0.0, 0.0], [0.9, 0.0]]), np.array([[1.0, 0.0], [1.9, 0.0]])
    assert gospa(estimate, truth).total_m == pytest.approx(np.sqrt(2.0))
    assert gospa(np.array([[50.0, 0.0]]), truth[:1]).total_m == pytest.approx(2.0)


def test_a_second_copy_stands_for_nothing() -> None:
    truth = np.array([[0.0, 0.0], [3.0, 0.0]])
    assert matched(np.array([[0.5, 0.0], [0.1, 0.0]]), truth).tolist() == [1, -1]
    assert matched(np.array([[1.2, 0.0]]), truth).tolist() == [-1, -1]


def test_rates_are_those_stated(model) -> None:
    recording = make_recording(model, 400)
    rates = Rates(clutter=0.2, misses=0.3)
    drive = disturbed(recording, rates, keyed_generator("rates", 0))
    names = [name for own in drive.labels for name in own]
    kept = sum(name != CLUTTER for name in names)
    assert kept / 1200 == pytest.approx(0.7, abs=0.05)  # four standard deviations
    assert names.count(CLUTTER) / len(names) == pytest.approx(0.2, abs=0.05)
    assert alarms_per_frame(recording, rates) == pytest.approx(3 * 0.7 * 0.25)
    for keyframe, own in zip(drive.keyframes, drive.labels, strict=True):
        assert len(keyframe.measurements) == len(own) == len(keyframe.measurements.features)
        assert (np.diff(keyframe.measurements.bearings_rad) <= 0.0).all()


def test_what_is_left_of_the_true_detections_is_untouched(model) -> None:
    recording = make_recording(model)
    drive = disturbed(recording, Rates(clutter=0.3, misses=0.3), keyed_generator("same", 0))
    for keyframe, own, before in zip(drive.keyframes, drive.labels, recording.keyframes, strict=True):
        for row, name in enumerate(own):
            if name != CLUTTER:
                assert keyframe.measurements.ranges_m[row] == before.measurements.ranges_m[int(name) - 1]
                np.testing.assert_array_equal(
                    keyframe.measurements.features[row], before.measurements.features[int(name) - 1]
                )


def test_odometry_has_errors_of_the_stated_size(model) -> None:
    recording = make_recording(model, 400)
    noise = OdometryConfiguration(0.0, 0.0, 0.0, 0.05, 0.02)
    drive = disturbed(recording, Rates(0.0, 0.0, noise), keyed_generator("odometry", 0))
    errors = []
    for k in range(1, 400):
        true = se2.between(recording.truth[k - 1], recording.truth[k])
        errors.append(se2.log(se2.between(true, planar_from_pose_vector(drive.keyframes[k].odometry))))
    np.testing.assert_allclose(np.std(errors, axis=0), [0.05, 0.05, 0.02], rtol=0.15)


@pytest.mark.slow
def test_every_method_maps_three_objects(model) -> None:
    """Without clutter and misses every method finds the three, and the open world their classes."""
    recording = make_recording(model)
    drive = disturbed(recording, Rates(0.0, 0.0), keyed_generator("clean", 0))
    for method in study.METHODS:
        row = score(study._driven(method, drive, Rates(0.0, 0.0), 0.01), drive, 0)
        assert not row.fault
        assert (row.metrics["ghosts"], row.metrics["missing"]) == (0.0, 0.0), method
        assert row.metrics["association_f1"] == pytest.approx(1.0), method
        assert row.metrics["ate_m"] < 0.1
        if method == "ours":
            assert (row.class_probabilities.argmax(axis=1) == row.true_classes).all()
            assert row.metrics["nll"] < 0.3


@pytest.mark.long
@pytest.mark.slow
def test_a_result_and_its_page(model, monkeypatch, tmp_path) -> None:
    recording = make_recording(model, 3)
    monkeypatch.setattr(study, "record_scene", lambda room, limit: replace(recording, scene=room))
    monkeypatch.setattr(study, "QUICK_ROOMS", 2)
    files = study.run(tmp_path, quick=True, jobs=1, seed=0)
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert result["num_runs"] == {"default": 2, "slippery": 2}
    assert set(result["methods"]) == set(study.METHODS)
    ours = result["methods"]["ours"]
    mean = np.mean([run["gospa_m"] for run in result["runs"]["default"]["ours"]])
    assert ours["gospa_m"] == pytest.approx(mean)
    assert len(result["claims"]) == 8
    assert files[1].read_text(encoding="utf-8").count("<img") == 2


def test_scores_of_a_run_that_found_nothing(model) -> None:
    """Missing objects: GOSPA sqrt(3 * 2), the even distribution over the classes."""
    recording = make_recording(model, 3)
    outcome = study._driven("ours", recording, Rates(0.0, 0.0), 0.01)
    nothing = replace(outcome, existence=np.zeros_like(outcome.existence), filtered=recording.truth)
    row = score(nothing, recording, 0)
    assert row.metrics["gospa_m"] == pytest.approx(np.sqrt(6.0))
    assert row.metrics["missing"] == 3.0
    assert row.metrics["nll"] == pytest.approx(np.log(len(model.class_names)))
    assert row.metrics["nees"] == pytest.approx(0.0)
    assert row.metrics["ate_m"] == absolute_trajectory_error(outcome.poses[:, :2], recording.truth[:, :2])


def test_classes_of_a_method_without_class_models_are_the_product_of_the_networks_scores(model) -> None:
    """Twelve views of three objects, each of its own association; the floor of a score is 0.01."""
    recording = make_recording(model)
    outcome = study._driven("ours", recording, Rates(0.0, 0.0), 0.01)
    plain = replace(
        outcome,
        class_names=(),
        associations=[(0, 1, 2)] * 12,
        object_ids=np.arange(3),
        objects=OBJECTS[:, :2],
        existence=np.ones(3),
    )
    found = score(plain, recording, 0).class_probabilities
    views = np.array([own.measurements.class_probability_samples.mean(axis=1) for own in recording.keyframes])
    product = np.maximum(views, 0.01).prod(axis=0)
    np.testing.assert_allclose(found, product / product.sum(axis=1, keepdims=True), rtol=1e-9)


@pytest.mark.parametrize(("ours", "other", "holds"), [(1e-9, 1e-8, False), (0.1, 0.1005, False), (0.1, 0.3, True)])
def test_a_class_nll_has_to_be_smaller_by_more_than_nothing(ours: float, other: float, holds: bool) -> None:
    row = {"runs_without_ghost": 1.0, "runs_complete": 1.0, "gospa_m": 0.3, "nll": other}
    methods = {"ours": {**row, "gospa_m": 0.2, "nll": ours}, "no_semantics": row}
    *_, of_gospa, of_nll = claims_of({"lines": {"default": methods}, "num_runs": {"default": 30}})
    assert of_gospa.holds and of_nll.holds == holds


@pytest.mark.parametrize(("settles", "alike", "count"), [(False, True, 1), (True, True, 0), (False, False, 0)])
def test_a_hypothesis_in_which_a_ghost_is_none_is_no_copy(settles: bool, alike: bool, count: int) -> None:
    """Two hypotheses that differ only in whether a second detection settled an object, or in what they are sure of."""
    sure = np.ones((2, 2), dtype=bool)
    sure[0, 1] = sure[1, 0] = alike
    looks = MergeCandidates(
        poses=np.tile(pose_vector_from_planar(np.zeros(3)), (2, 1)),
        objects=np.zeros((2, 1, 3)),
        classes=np.full((2, 1), -1),
        confirms=np.array([[False], [settles]]),
        parents=np.array([0, 1]),
        alike=sure,
    )
    merged = merge_copies(looks, np.log([0.6, 0.4]), np.array([1, 2], dtype=np.uint64), OpenWorldConfiguration())
    assert merged.count == count
