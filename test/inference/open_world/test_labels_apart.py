"""What a detector says may move is none of what it says does not, unless it is mistaken."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.configuration import MovingConfiguration
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.open_world.moving.labels_apart import LOG_MISTAKEN, LabelsApart
from semantic_slam.inference.world.objects import ObjectRegistry

BY_LABEL = ("robot=0.5", "person=0.9", "post=0.0")


def labels_apart(*keyframes: tuple[str, ...]) -> LabelsApart:
    """With objects that may have begun in some keyframes, numbered through."""
    registry = ObjectRegistry((), np.ones(1))
    for index, labels in enumerate(keyframes):
        registry.reserve(index, len(labels), labels)
    return LabelsApart(Moving(MovingConfiguration(share_by_label=BY_LABEL)), registry)


def test_a_mistake_costs_what_it_says_and_what_is_not_told_costs_nothing() -> None:
    apart = labels_apart(("post", "robot"), ("", "Person", "tree"))
    found = apart.log_factors(("robot", "POST", "person", "", "tree"), np.arange(5))
    mistaken = np.array(
        [  # post, robot, nothing, person, tree: a label that no table has does not move where the share is 0
            [1, 0, 0, 0, 1],
            [0, 1, 0, 1, 0],
            [1, 0, 0, 0, 1],
            [0, 0, 0, 0, 0],
            [0, 1, 0, 1, 0],
        ]
    )
    np.testing.assert_array_equal(found, LOG_MISTAKEN * mistaken)


def test_what_the_map_has_is_not_told() -> None:
    assert labels_apart(("post",)).log_factors(("robot",), np.array([7])).tolist() == [[0.0]]


def test_a_joint_assignment_costs_the_sum_of_its_pairs() -> None:
    apart = labels_apart(("post", "robot", "post"))
    found = apart.log_factor(("robot", "post"), np.array([[0, 1], [1, 0], [1, 2], [0, 2]]))
    np.testing.assert_allclose(found, LOG_MISTAKEN * np.array([2.0, 0.0, 0.0, 1.0]))
    assert apart.log_factor((), np.zeros((3, 0), dtype=int)).tolist() == [0.0, 0.0, 0.0]


def weight_of_post(label: str) -> float:
    """Of the history in which a detection some way off a post that is not seen is of the post."""
    settings = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world={"iterate_updates": False, "max_range_m": 6.0, "clutter_per_frame": 0.05},
        moving={"share_by_label": list(BY_LABEL)},
    )
    engine = Engine(settings, initial_covariance=np.diag([1e-6] * 3))
    for k in range(6):
        sight = Detection(
            range_m=3.0,
            bearing_rad=0.0 if k < 5 else 0.13,
            covariance=np.diag([0.1, 0.03]) ** 2,
            label="post" if k < 5 else label,
            score=0.9,
        )
        engine.process(Keyframe.planar(k, detections=[sight], motion_sigmas=(1e-3,) * 3))
    weights = {own.lineage[-1].association: np.exp(own.log_weight) for own in engine.live.values()}
    return float(weights[(0,)])


def test_a_robot_beside_a_post_that_is_not_seen_is_fifty_times_likelier_a_thing_of_its_own() -> None:
    post, robot = weight_of_post("post"), weight_of_post("robot")
    assert (1.0 - robot) / robot * post / (1.0 - post) == pytest.approx(np.exp(-LOG_MISTAKEN), rel=1e-6)
    assert weight_of_post("") == post
