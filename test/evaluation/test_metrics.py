"""Metrics against closed forms; the answers are derived in the comments."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import small_belief

from semantic_slam.evaluation import classification, history, mixture, trajectory
from semantic_slam.evaluation.association import annotated_pair_score, objects_without_reference, pair_score
from semantic_slam.geometry.moments import matched_moments
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.entropy import association_entropy, component_entropy

FIXTURE = json.loads((Path(__file__).parents[1] / "fixtures" / "ch4_models_deterministic.json").read_text())["metrics"]


def test_entropies_and_errors_of_the_fixture() -> None:
    given = {name: np.array(value) for name, value in FIXTURE["input"].items()}
    weights, truth = given["w"], given["x_gt"]
    measured = {
        "H_components": component_entropy(weights),
        "H_beta": association_entropy(weights, FIXTURE["input"]["beta_id"]),
        "det_position_of_max": mixture.position_determinant(weights, given["cov"]),
        "err_max": mixture.heaviest_position_error(weights, given["mean"], truth),
        "err_weighted": mixture.weighted_position_error(weights, given["mean"], truth),
    }
    assert measured == pytest.approx({name: FIXTURE[name] for name in measured}, abs=1e-9)


def test_entropy_limits() -> None:
    assert component_entropy(np.array([1.0, 0.0])) == 0.0
    assert component_entropy(np.full(8, 1 / 8)) == pytest.approx(math.log(8))
    # One association history only: no ambiguity of association, however many classes and modes share it.
    assert association_entropy(np.full(8, 1 / 8), ["same"] * 8) == 0.0


def test_pair_score_of_a_split_and_of_a_merge() -> None:
    # Truth: one object seen 4 times, 6 pairs. Split in 2 + 2: 2 pairs claimed, both right.
    split = pair_score([0, 0, 1, 1], [7, 7, 7, 7])
    assert (split.precision, split.recall, split.f1) == (1.0, 2 / 6, 2 * 2 / (2 + 6))
    # Truth: two objects seen twice, 2 pairs. Merged: 6 pairs claimed, 2 of them right.
    merged = pair_score([3, 3, 3, 3], [0, 0, 1, 1])
    assert (merged.precision, merged.recall, merged.f1) == (2 / 6, 1.0, 2 * 2 / (6 + 2))


def test_pair_score_does_not_depend_on_names_and_takes_clutter_alone() -> None:
    assert pair_score([5, 5, 9], [0, 0, 1]) == pair_score([1, 1, 0], [0, 0, 1])
    # Two clutter detections are no pair, in neither of both; claiming one for them costs precision.
    assert pair_score([0, 0, -1, -1], [4, 4, -1, -1]).f1 == 1.0
    assert pair_score([0, 0, 1, 1], [4, 4, -1, -1]).precision == 0.5
    assert math.isnan(pair_score([0, 1], [0, 1]).f1)


def test_what_nobody_annotated_costs_pairs_in_the_one_score_and_none_in_the_other() -> None:
    """A table (object 5) of four boxes without a true id, and one false alarm in object 1."""
    estimate, reference = [1, 1, 1, 2, 2, 5, 5, 5, 5], [7, 7, -1, 8, 8, -1, -1, -1, -1]
    whole = pair_score(estimate, reference)
    assert (whole.precision, whole.recall, whole.f1) == (2 / 10, 1.0, 4 / 12)
    known = annotated_pair_score(estimate, reference)
    assert (known.precision, known.recall, known.f1) == (1.0, 1.0, 1.0)
    split = annotated_pair_score([1, 3, 1, 2, 2, 5, 5, 5, 5], reference)
    assert (split.precision, split.recall) == (1.0, 0.5), "a true error is still one"
    assert objects_without_reference(estimate, reference) == {5}


def test_true_association_probability_follows_the_parents() -> None:
    # Keyframe 0: hypothesis 1 sees object 10 (true), 2 sees object 20. Keyframe 1: all see object 20 (true),
    # but 4 and 5 descend from 2: only hypothesis 3 has the true history. Keyframe 2: 6 grew from 3, 7 from 5.
    beliefs = [
        small_belief(0, ids=[1, 2], parents=[0, 0], weights=[0.6, 0.4], objects=[10, 20], associations=[[0], [1]]),
        small_belief(
            1, ids=[3, 4, 5], parents=[1, 2, 2], weights=[0.5, 0.3, 0.2], objects=[10, 20], associations=[[1], [1], [1]]
        ),
        small_belief(2, ids=[6, 7], parents=[3, 5], weights=[0.995, 0.005], objects=[10, 20], associations=[[0], [0]]),
    ]
    truth = [np.array([10]), np.array([20]), np.array([10])]
    probability = history.true_association_probability(beliefs, truth)
    assert probability == pytest.approx([0.6, 0.5, 0.995])
    assert history.first_settled(probability) == 2
    assert history.lineage(beliefs) == [0, 0, 0]
    # Not knowing the last frame's truth judges it by its past; an object missing in the map can never be right.
    truth[2] = np.array([history.UNKNOWN])
    assert history.true_association_probability(beliefs, truth)[2] == pytest.approx(0.995)
    truth[2] = np.array([history.UNMATCHED])
    assert history.true_association_probability(beliefs, truth)[2] == 0.0


def test_components_of_one_history_add_up() -> None:
    # Two classes of the same association: P(history) is the sum of both.
    belief = small_belief(
        0, ids=[1, 2, 3], parents=[0, 0, 0], weights=[0.5, 0.3, 0.2], objects=[4, 5], associations=[[0], [0], [1]]
    )
    assert history.true_association_probability([belief], [np.array([4])]) == pytest.approx([0.8])


def test_settled_means_for_good() -> None:
    assert history.first_settled(np.array([1.0, 0.2, 0.99, 1.0])) == 2
    assert history.first_settled(np.array([1.0, 1.0])) == 0
    assert history.first_settled(np.array([1.0, 0.98])) is None
    assert history.first_settled(np.array([])) is None


def test_lineage_that_is_not_recorded() -> None:
    beliefs = [
        small_belief(0, ids=[1], parents=[0], weights=[1.0], objects=[4], associations=[[0]]),
        small_belief(2, ids=[3], parents=[2], weights=[1.0], objects=[4], associations=[[0]]),
    ]
    assert history.lineage(beliefs) == [-1, 0]


def test_class_scores() -> None:
    probabilities = np.array([[0.9, 0.1], [0.9, 0.1], [0.6, 0.4]])
    true = np.array([0, 1, 0])
    expected = -(math.log(0.9) + math.log(0.1) + math.log(0.6)) / 3
    assert classification.negative_log_likelihood(probabilities, true) == pytest.approx(expected)
    # Bin of 0.9: accuracy 1/2, gap 0.4, two rows. Bin of 0.6: accuracy 1, gap 0.4, one row.
    assert classification.expected_calibration_error(probabilities, true) == pytest.approx((2 * 0.4 + 0.4) / 3)
    certain = np.eye(3)
    assert classification.expected_calibration_error(certain, np.arange(3)) == 0.0
    assert math.isnan(classification.expected_calibration_error(np.zeros((0, 2)), np.zeros(0, dtype=int)))


def test_errors_of_a_trajectory_and_its_alignment() -> None:
    generator = np.random.default_rng(1)
    for axes in (2, 3):
        reference = generator.normal(size=(20, axes))
        rotation = np.linalg.qr(generator.normal(size=(axes, axes)))[0]
        rotation[:, 0] *= np.sign(np.linalg.det(rotation))
        moved = reference @ rotation.T + 3.0
        assert trajectory.absolute_trajectory_error(trajectory.align(moved, reference), reference) < 1e-9
    # A pure shift by (3, 4) is an error of 5 everywhere; a row without an estimate does not count.
    shifted = np.vstack([reference[:, :2] + [3.0, 4.0], [np.nan, 0.0]])
    assert trajectory.absolute_trajectory_error(shifted, np.vstack([reference[:, :2], [0.0, 0.0]])) == pytest.approx(
        5.0
    )


def test_alignment_is_no_reflection() -> None:
    reference = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]])
    mirrored = reference * [-1.0, 1.0]
    assert trajectory.absolute_trajectory_error(trajectory.align(mirrored, reference), reference) > 0.1


def test_dead_reckoning_carries_the_odometry_into_the_map() -> None:
    # Odometry starts at (1, 0) facing y and drives 2 m forward; in map the robot starts at (5, 5) facing x.
    odometry = pose_vector_from_planar(np.array([[1.0, 0.0, math.pi / 2], [1.0, 2.0, math.pi / 2]]))
    start = pose_vector_from_planar(np.array([5.0, 5.0, 0.0]))
    expected = pose_vector_from_planar(np.array([[5.0, 5.0, 0.0], [7.0, 5.0, 0.0]]))
    assert trajectory.dead_reckoning(start, odometry) == pytest.approx(expected, abs=1e-12)


def test_interpolation_between_and_outside() -> None:
    poses = pose_vector_from_planar(np.array([[0.0, 0.0, 0.0], [2.0, 4.0, 1.0]]))
    found = trajectory.interpolate(trajectory.Trajectory(np.array([0, 10**9]), poses), np.array([-1, 5 * 10**8]))
    assert np.isnan(found[0]).all()
    assert found[1] == pytest.approx(pose_vector_from_planar(np.array([1.0, 2.0, 0.5])))


def test_moments_of_two_components() -> None:
    # Means at x = -1 and 1 with weight 1/2 and variance 0.1 each: mean 0, variance 0.1 + 1. Yaws of pi - 0.1 and
    # -pi + 0.1 average to pi, never to 0, with variance 0.1 + 0.01.
    poses = pose_vector_from_planar(np.array([[-1.0, 0.0, math.pi - 0.1], [1.0, 0.0, -math.pi + 0.1]]))
    mean, covariance = matched_moments(np.array([0.5, 0.5]), poses, np.stack([0.1 * np.eye(6)] * 2))
    assert mean[:2] == pytest.approx([0.0, 0.0])
    assert abs(mixture.pose_error(pose_vector_from_planar(np.array([[0.0, 0.0, math.pi]])), mean)[0, 5]) < 1e-12
    assert covariance[0, 0] == pytest.approx(1.1)
    assert covariance[5, 5] == pytest.approx(0.11)
    assert covariance[0, 5] == pytest.approx(0.1)  # x and yaw grow together: 1/2 (-1)(-0.1) + 1/2 (1)(0.1)


def test_nees_averages_to_the_dimension() -> None:
    generator = np.random.default_rng(2)
    covariance = np.array([[0.5, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, 0.1]])
    errors = generator.multivariate_normal(np.zeros(3), covariance, size=4000)
    values = [mixture.normalised_error_squared(error, covariance) for error in errors]
    # chi-square with 3 degrees of freedom: mean 3, variance 6; five standard errors are 5 sqrt(6 / 4000) = 0.19.
    assert np.mean(values) == pytest.approx(3.0, abs=0.19)
    assert math.isnan(mixture.normalised_error_squared(np.ones(2), np.zeros((2, 2))))
