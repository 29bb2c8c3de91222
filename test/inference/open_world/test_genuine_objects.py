"""What is detected again and again with the scores of mistakes is said not to exist; all else is as it was."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from worlds.drives.open_room import make_room

from semantic_slam import Configuration, InputError
from semantic_slam.configuration import DetectionErrorsConfiguration, OpenWorldConfiguration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.open_world.genuine_objects import GenuineObjects
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.lineage import LineageStep

ERRORS = DetectionErrorsConfiguration(correlated_share=0.5, motion_m=1.0)
ON = OpenWorldConfiguration(learn_scores=True)
KEYFRAMES, DOUBTED = 60, 2


def step_of(index: int, scores: np.ndarray) -> Step:
    return Step(
        index=index,
        stamp_ns=index,
        motion=Motion(np.array([1.0, 0.0, 0.0]), np.eye(3)),
        detections=[None] * len(scores),
        detection_ids=np.arange(len(scores), dtype=np.uint32),
        scores=scores,
        names=("",) * len(scores),
        in_coverage=np.ones(len(scores), dtype=bool),
    )


def hypothesis(count: int, parent: int) -> Hypothesis:
    step = LineageStep(association=(0, 1, DOUBTED), class_assignment=(-1, -1, -1), mode=0)
    return Hypothesis(owner=0, log_weight=0.0, parent_id=parent, lineage=(step,) * count)


def followed(
    settings: OpenWorldConfiguration = ON, errors: DetectionErrorsConfiguration = ERRORS
) -> tuple[GenuineObjects, np.ndarray | None]:
    """Three objects in each keyframe, of which the last has low scores."""
    rng, genuine, found = np.random.default_rng(0), GenuineObjects(settings, errors), None
    for index in range(KEYFRAMES):
        odds = np.array([rng.normal(8.0, 2.0), rng.normal(9.0, 2.0), rng.normal(0.0, 1.0)])
        genuine.note(step_of(index, 1.0 / (1.0 + np.exp(-odds))))
        live = {index + 100: hypothesis(index + 1, index + 99)}
        found = genuine.shares(live, [0, 1, DOUBTED, 7], np.ones((1, 4)))
    return genuine, found


def test_what_scores_low_again_and_again_is_a_mistake() -> None:
    found = followed()[1]
    assert found is not None
    np.testing.assert_allclose(found, [[1.0, 1.0, 0.0, 1.0]], atol=0.1)


def test_of_listed_shares_that_repeat_the_mean_counts_and_not_the_share_that_they_replace() -> None:
    listed = [replace(ERRORS, correlated_share=own, correlated_shares=(0.1, 0.5)) for own in (0.0, 0.99)]
    found = [followed(errors=own)[1] for own in (*listed, replace(ERRORS, correlated_share=0.3))]
    assert all(own is not None for own in found)
    np.testing.assert_allclose(found[0], found[2])
    np.testing.assert_allclose(found[1], found[2])


def test_a_robot_that_hardly_moves_learns_little_from_more_scores() -> None:
    """Of a doubtful score a slow robot hears the same again; a fast one hears others that say the same."""
    found = {}
    for pace in (0.01, 5.0):
        genuine, rng = GenuineObjects(ON, replace(ERRORS, correlated_share=0.9)), np.random.default_rng(0)
        for index in range(400):
            odds = np.append(rng.normal([8.0, 0.0], [2.0, 1.0]), 2.2)
            motion = Motion(np.array([pace, 0.0, 0.0]), np.eye(3))
            genuine.note(replace(step_of(index, 1.0 / (1.0 + np.exp(-odds))), motion=motion))
        steps = tuple(LineageStep((0, 1, DOUBTED if k < 4 else -1), (-1, -1, -1), mode=0) for k in range(400))
        live = {500: Hypothesis(owner=0, log_weight=0.0, parent_id=499, lineage=steps)}
        shares = genuine.shares(live, [0, 1, DOUBTED], np.ones((1, 3)))
        assert shares is not None
        found[pace] = shares[0]
    np.testing.assert_allclose([own[:DOUBTED] for own in found.values()], [[1.0, 0.0]] * 2, atol=0.05)
    assert abs(found[5.0][DOUBTED] - 0.5) > abs(found[0.01][DOUBTED] - 0.5)


def test_a_history_that_enters_late_knows_as_much_as_one_that_was_followed() -> None:
    genuine, found = followed()
    assert found is not None
    late = genuine.shares({9999: hypothesis(KEYFRAMES, 8888)}, [0, 1, DOUBTED, 7], np.ones((1, 4)))
    np.testing.assert_allclose(late, found, rtol=1e-12)


def test_scores_tell_nothing_unless_asked_for() -> None:
    assert followed(OpenWorldConfiguration())[1] is None


def with_scores(keyframe: Keyframe, score: Any) -> Keyframe:
    scores = np.full(len(keyframe.measurements), score, dtype=np.float64)
    return replace(keyframe, measurements=replace(keyframe.measurements, scores=scores))


@pytest.mark.parametrize("score", [1.0, np.nan])
def test_scores_that_are_all_alike_change_no_belief(score: float) -> None:
    plain, asked = make_room(10, seed=0), make_room(10, seed=0, open_world={"learn_scores": True})
    runs = [Engine.of_run(room.run, InProcessPool(1)) for room in (plain, asked)]
    for keyframe in plain.keyframes:
        one, other = (engine.process(with_scores(keyframe, score)) for engine in runs)
        np.testing.assert_array_equal(one.existence, other.existence)


def test_what_was_seen_once_is_doubted_with_the_scores_of_what_was_not_there_again() -> None:
    """Of two objects that places know as well, one scores as things seen again do, and one as those given up did."""
    rng, genuine = np.random.default_rng(1), GenuineObjects(OpenWorldConfiguration(learn_alarm_scores=True), ERRORS)
    steps = []
    for index in range(40):
        odds = np.array([rng.normal(2.0, 0.5), rng.normal(-1.0, 0.5)])
        if index == 39:
            odds = np.array([2.0, -1.0])
        genuine.note(step_of(index, 1.0 / (1.0 + np.exp(-odds))))
        taken = (100, 101) if index == 39 else (index % 10, 20 + index)  # a thing, and what is given up
        steps.append(LineageStep(association=taken, class_assignment=(-1, -1), mode=0))
    live = {7: Hypothesis(owner=0, log_weight=0.0, parent_id=6, lineage=tuple(steps))}
    shares = genuine.shares(live, [*range(10), 100, 101], np.array([[1.0] * 10 + [0.6] * 2]))
    assert shares is not None
    np.testing.assert_allclose(shares[0, :10], 1.0)
    assert 0.6 * shares[0, 10] > 0.95 and 0.6 * shares[0, 11] < 0.05


def test_scores_are_not_counted_twice() -> None:
    both = {"learn_scores": True, "learn_alarm_scores": True}
    with pytest.raises(InputError, match="learn_alarm_scores"):
        Engine(Configuration.of(association="open", open_world=both))
