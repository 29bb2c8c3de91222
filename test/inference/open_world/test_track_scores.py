"""What was seen twice may be two false alarms: the belief says so, whether or not it follows the history that does."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail
from semantic_slam.inference.object_table import without_views
from semantic_slam.inference.open_world.joint.leave_one_out import log_density_of_each
from semantic_slam.inference.open_world.joint.linear_evidence import JointInnovation
from semantic_slam.inference.states.track_scores import existence_beside_rivals, log_odds

DETECTED, CLUTTER, BIRTHS = 0.7, 2.0, 0.05
SETTINGS = {
    "detection_probability": DETECTED,
    "clutter_per_frame": CLUTTER,
    "birth_density": BIRTHS,
    "field_of_view_rad": 2.0,
    "max_range_m": 6.0,
    "min_range_m": 0.3,
}
VARIANCE = 0.04
AREA = 0.5 * 2.0 * (6.0**2 - 0.3**2)


def stare(seen: list[bool], max_hypotheses: int) -> HybridBelief:
    """The belief of a robot at rest that detects something at one place in some of its keyframes."""
    engine = Engine(
        Configuration.of(
            association="open",
            semantic_model={"kind": "none"},
            open_world=SETTINGS,
            pruning={"max_hypotheses": max_hypotheses},
        )
    )
    for k, is_seen in enumerate(seen):
        detections = [Detection.at(3.0, 0.0, covariance=VARIANCE * np.eye(2))] if is_seen else []
        belief = engine.process(Keyframe.planar(k, detections=detections))
    return belief


def test_the_score_of_a_thing_is_the_ratio_to_false_alarms_in_closed_form() -> None:
    """Of two detections at one place, and two misses, as the robot hardly moves."""
    belief = stare([True, True, False, False], max_hypotheses=1)
    first, again = BIRTHS * DETECTED, DETECTED / (2.0 * np.pi * 2.0 * VARIANCE)
    expected = np.log(first * again / (CLUTTER / AREA) ** 2) + 2.0 * np.log(1.0 - DETECTED)
    assert belief.track_scores[0] == pytest.approx(expected, abs=0.05)
    assert belief.existence[0] == pytest.approx(1.0 / (1.0 + np.exp(-expected)), abs=0.02)


@pytest.mark.parametrize("misses", [0, 2, 4, 6])
def test_one_history_doubts_what_two_alarms_may_be_as_many_histories_do(misses: int) -> None:
    """Up to the rivals in which one of the detections is an alarm, and the other one of a thing."""
    every, one = (stare([True, True] + [False] * misses, count).existence[0] for count in (100, 1))
    assert every - 0.01 <= one <= every + 0.2


def test_what_is_doubted_by_histories_that_are_followed_is_not_doubted_twice() -> None:
    """The second hypothesis is the rival of the first one: object 1 has detections of false alarms there."""
    score = 1.5
    weights = np.array([1.0, np.exp(-score)]) / (1.0 + np.exp(-score))
    factors = existence_beside_rivals(weights, np.array([[1.0], [0.0]]), np.array([[score], [np.nan]]))
    assert factors == pytest.approx(1.0, abs=0.0)
    alone = existence_beside_rivals(np.ones(1), np.ones((1, 1)), np.array([[1.0]]))
    assert alone == pytest.approx(1.0 / (1.0 + np.exp(-1.0)), rel=1e-12)


def test_what_no_hypothesis_knows_or_a_map_is_sure_of_stays_as_it_is() -> None:
    existence, scores = np.array([[np.nan, 1.0]]), np.array([[np.nan, log_odds(np.ones(1))[0]]])
    factors = existence_beside_rivals(np.ones(1), existence, scores)
    assert factors.tolist() == [1.0, 1.0]


def test_what_moves_in_one_hypothesis_and_stands_in_another_exists_in_both() -> None:
    """Where it moves, it has no track score, and does not leave."""
    known = {"existence": np.ones((2, 1)), "missing": np.array([[np.nan], [0.0]])}
    table = without_views(2, np.ones((1, 1)), **known, track_scores=np.array([[np.nan], [-2.0]]))
    factors = existence_beside_rivals(np.array([0.5, 0.5]), table.existed, table.track_scores)
    assert factors == pytest.approx(1.0 - 0.5 / (1.0 + np.exp(-2.0)), rel=1e-12)


def innovation(rng: np.random.Generator, count: int) -> JointInnovation:
    root = rng.normal(size=(2 * count, 2 * count))
    return JointInnovation(
        residual=rng.normal(size=2 * count),
        jacobian=rng.normal(size=(2 * count, 3)),
        cross=np.zeros((2 * count, 3)),
        covariance=root @ root.T + np.eye(2 * count),
        log_normalisers=rng.normal(size=count),
    )


def log_gaussian(residual: np.ndarray, covariance: np.ndarray) -> float:
    return float(-0.5 * residual @ np.linalg.solve(covariance, residual) - 0.5 * np.linalg.slogdet(covariance)[1])


def test_the_density_of_one_detection_is_the_joint_one_over_that_of_the_others() -> None:
    joint = innovation(np.random.default_rng(0), 4)
    found = log_density_of_each(joint, None)
    for left_out in range(4):
        others = np.delete(np.arange(8), [2 * left_out, 2 * left_out + 1])
        ratio = log_gaussian(joint.residual, joint.covariance)
        ratio -= log_gaussian(joint.residual[others], joint.covariance[np.ix_(others, others)])
        assert found[left_out] == pytest.approx(joint.log_normalisers[left_out] + ratio, abs=1e-9)


def test_a_detection_far_off_has_at_least_the_density_of_an_outlier() -> None:
    joint, tail = innovation(np.random.default_rng(1), 3), HeavyTail(share=0.05, width=5.0)
    joint.residual[:2] = 60.0
    plain, mixed = log_density_of_each(joint, None), log_density_of_each(joint, tail)
    assert mixed[0] > plain[0] + 10.0
    wide = joint.covariance.copy()
    wide[:2, :2] += tail.added * np.eye(2)
    around = np.linalg.inv(np.linalg.inv(wide)[:2, :2])
    off = (around @ (np.linalg.inv(wide) @ joint.residual)[:2])[:2]
    expected = joint.log_normalisers[0] + tail.log_share + log_gaussian(off, around)
    assert mixed[0] == pytest.approx(expected, abs=1e-6)
