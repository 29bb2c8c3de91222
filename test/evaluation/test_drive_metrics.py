"""Metrics of drives on cases whose answers are derived in the comments."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.belief_factory import small_belief

from semantic_slam.evaluation import clusters, mixture, pairs, trajectory
from semantic_slam.evaluation.history import best_history, histories
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar


def test_clusters_are_chains_of_near_neighbours() -> None:
    # 0 - 0.4 - 0.8 is a chain although its ends are 0.8 m apart; 2.0 stands alone.
    found = clusters.clusters_of(np.array([[0.0, 0.0], [2.0, 0.0], [0.4, 0.0], [0.8, 0.0]]), 0.5)
    assert found[0] == found[2] == found[3] != found[1]
    assert clusters.clusters_of(np.array([[1.0, 1.0]]), 0.5).tolist() == [0]


def test_an_object_counts_as_of_the_cluster_that_most_of_its_detections_belong_to() -> None:
    # Cluster 0 seen 3 times, cluster 1 twice, one false reading. Objects 5 and 6 both stand for cluster 0, so that
    # splitting it costs nothing; object 7 stands for cluster 1, and one of cluster 1 was given to object 6.
    estimate, true = [5, 5, 6, 6, 6, 7, 8], [0, 0, 0, 0, 1, 1, -1]
    assert clusters.majority(estimate, true) == {5: 0, 6: 0, 7: 1}
    score = clusters.cluster_score(estimate, true)
    # Claimed: five detections in cluster 0 (10 pairs), one in 1. True: 4 in cluster 0 (6 pairs), 2 in 1 (1 pair).
    # Common: the four of cluster 0 (6 pairs).
    assert (score.precision, score.recall, score.f1) == (6 / 10, 6 / 7, 12 / 17)


def test_an_object_of_false_readings_alone_is_a_cluster_of_its_own() -> None:
    score = clusters.cluster_score([3, 3, 0, 0], [-1, -1, 0, 0])
    assert (score.precision, score.recall) == (1 / 2, 1.0)


def test_duplicates_of_one_cluster_do_not_pay_for_another() -> None:
    # Cluster 0 has two objects of which one was found, cluster 1 has one that was found three times.
    assert clusters.num_duplicates({10: 0, 11: 1, 12: 1, 13: 1}, {0: 2, 1: 1}) == 2


def test_pair_probabilities_are_judged_over_all_pairs_and_over_those_stated() -> None:
    # Two hypotheses, 0.6 and 0.4; four detections, truth a a b b.
    # The first: {0, 1}, {2}, {3}; the second: {0}, {1, 2}, 3 is clutter. Pairs stated: (0, 1) at 0.6, true;
    # (1, 2) at 0.4, false; the true pair (2, 3) and three others at 0.
    objects = np.array([[1, 1, 2, 3], [4, 5, 5, -1]])
    found = pairs.pair_calibration(np.array([0.6, 0.4]), objects, [0, 0, 1, 1])
    assert found.ece == pytest.approx((0.4 + 0.4 + 1.0) / 6)
    assert found.ece_of_stated == pytest.approx((0.4 + 0.4) / 2)
    assert np.isnan(found.right_at_90)


def test_sure_pairs_are_counted_one_by_one() -> None:
    # One hypothesis has five detections as one object; four of them are: 6 of 10 pairs, and every pair is sure.
    found = pairs.pair_calibration(np.array([1.0]), np.full((1, 5), 7), [0, 0, 0, 0, 1])
    assert found.right_at_90 == 6 / 10
    assert found.ece == pytest.approx(0.4)
    # Clutter is never of one object with clutter.
    assert pairs.pair_calibration(np.array([1.0]), np.full((1, 2), -1), [-1, -1]).ece == 0.0


def test_histories_follow_every_hypothesis_that_lives_at_the_end() -> None:
    beliefs = [
        small_belief(0, ids=[1, 2], parents=[0, 0], weights=[0.6, 0.4], objects=[10, 20], associations=[[0], [1]]),
        small_belief(1, ids=[3, 4], parents=[2, 1], weights=[0.7, 0.3], objects=[10, 20], associations=[[-1], [1]]),
    ]
    assert [row.ravel().tolist() for row in histories(beliefs)] == [[20, 10], [-1, 20]]


def test_a_revised_history_is_told_as_it_was_revised() -> None:
    """The later revision has the last word, and what it does not change is that of the parents."""
    known = {"objects": [10, 20, 30], "weights": [1.0]}
    beliefs = [
        small_belief(0, ids=[1], parents=[0], associations=[[0, 1, 2]], **known),
        replace(
            small_belief(1, ids=[2], parents=[1], associations=[[1]], **known),
            revised_ids=np.array([2, 2], dtype=np.uint64),
            revised_keyframes=np.array([0, 0], dtype=np.uint32),
            revised_detections=np.array([0, 1], dtype=np.uint32),
            revised_objects=np.array([30, 10], dtype=np.int32),
        ),
        replace(
            small_belief(2, ids=[3, 4], parents=[2, 2], associations=[[0], [2]], **(known | {"weights": [0.7, 0.3]})),
            revised_ids=np.array([4], dtype=np.uint64),
            revised_keyframes=np.array([0], dtype=np.uint32),
            revised_detections=np.array([1], dtype=np.uint32),
            revised_objects=np.array([-1], dtype=np.int32),
        ),
    ]
    first, second, third = histories(beliefs)
    assert first.tolist() == [[30, 10, 30], [30, -1, 30]]
    assert (second.tolist(), third.tolist()) == ([[20], [20]], [[10], [30]])
    assert [None if row is None else row.tolist() for row in best_history(beliefs)] == [[30, 10, 30], [20], [10]]


def test_alignment_moves_what_was_mapped_with_the_path() -> None:
    truth = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [np.nan, 0.0]])
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    motion = trajectory.alignment((truth - [3.0, 1.0]) @ turn, truth)
    np.testing.assert_allclose(motion.rotation, turn, atol=1e-12)
    np.testing.assert_allclose(motion.applied(np.zeros((1, 2))), [[3.0, 1.0]], atol=1e-12)
    assert trajectory.absolute_trajectory_error(motion.applied((truth - [3.0, 1.0]) @ turn), truth) < 1e-12


def test_relative_error_per_metre_of_an_odometer_that_reads_too_long() -> None:
    # Straight on in steps of 0.5 m; the estimate makes 0.55 m of each: 0.1 m after every metre. Where the two lie in
    # map does not matter. The last two poses have no metre ahead of them.
    true = np.stack([0.5 * np.arange(6), np.zeros(6), np.zeros(6)], axis=1)
    estimate = np.stack([np.full(6, 4.0), 0.55 * np.arange(6), np.full(6, np.pi / 2)], axis=1)
    assert trajectory.relative_error_per_metre(estimate, true) == pytest.approx(0.1)
    assert np.isnan(trajectory.relative_error_per_metre(estimate[:2], true[:2]))


def test_log_density_adds_the_components_up() -> None:
    # Two unit Gaussians over x, y, yaw with weights 1/4 and 3/4: the pose is the mean of the first and lies 1 m and
    # 2 rad from the second.
    means = pose_vector_from_planar(np.array([[1.0, 0.0, 0.5], [2.0, 0.0, 2.5]]))
    spread = covariance_from_planar(np.tile(np.eye(3), (2, 1, 1)))
    found = mixture.log_density(np.log([0.25, 0.75]), means, spread, means[0], (0, 1, 5))
    expected = np.log(0.25 + 0.75 * np.exp(-2.5)) - 1.5 * np.log(2 * np.pi)
    assert found == pytest.approx(expected)


def test_the_region_of_a_round_gaussian_is_a_circle() -> None:
    # Rayleigh: 95 % lie within sigma sqrt(-2 ln 0.05).
    edge = 0.1 * np.sqrt(-2.0 * np.log(0.05))
    alone = np.ones(1), np.zeros((1, 2)), 0.01 * np.eye(2)[None]
    inside, radius = mixture.position_region(*alone, np.array([0.99 * edge, 0.0]))
    assert inside and radius == pytest.approx(edge, rel=5e-3)
    assert not mixture.position_region(*alone, np.array([0.0, 1.01 * edge]))[0]


def test_the_region_of_a_mixture_holds_as_much_of_it_as_it_says() -> None:
    """Draws of a mixture with heavy tails; the ellipse of a Gaussian with its moments would hold less than 93 %."""
    random = np.random.default_rng(0)
    weights, positions = np.array([0.8, 0.2]), np.array([[0.0, 0.0], [0.1, -0.2]])
    covariances = np.array([np.diag([0.01, 0.02]), np.diag([0.4, 0.2])])
    which = random.choice(2, 2000, p=weights)
    sigmas = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    draws = positions[which] + random.normal(size=(2000, 2)) * sigmas[which]
    held = [mixture.position_region(weights, positions, covariances, draw)[0] for draw in draws]
    assert np.mean(held) == pytest.approx(0.95, abs=0.01)
