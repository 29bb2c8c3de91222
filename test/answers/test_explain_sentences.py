"""The sentences of ``semantic_slam explain`` on the class, the views and their association."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.scenes.planar_world import make_world

from semantic_slam.answers.explain.explanation import Explanation, explanation_of
from semantic_slam.answers.explain.replayed_run import replay
from semantic_slam.answers.explain.rivals import Rival
from semantic_slam.answers.explain.sentences import sentences
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool

IT, OTHER = 1, 2
"""Objects of the world: the one that is explained, and another one."""


@pytest.fixture(scope="module")
def explanation() -> Explanation:
    world = make_world(3, semantic_model={"kind": "parametric"})
    engine = Engine.of_run(world.run, InProcessPool(1))
    beliefs = tuple(engine.process(keyframe) for keyframe in world.keyframes)
    measurements = {keyframe.stamp_ns: keyframe.measurements for keyframe in world.keyframes}
    no_track = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))
    record = Record(world.run, beliefs, no_track, measurements, None)
    return explanation_of(record, replay(record, world.keyframes, [IT]), IT)


def rival(keyframe: int, taken_id: int, object_id: int, then: float, **ended: float | None) -> Rival:
    """An alternative that was dropped in the next keyframe, 7 nats behind, unless ``ended`` says otherwise."""
    values = {"now": 0.0, "gone": keyframe + 1, "log_odds_before": 0.0, "log_odds": -7.0, **ended}
    return Rival(keyframe=keyframe, detection=0, taken_id=taken_id, object_id=object_id, then=then, by=(), **values)


@pytest.mark.parametrize(
    ("rivals", "expected"),
    [
        ((), "All its views are unambiguous."),
        (
            (rival(0, OTHER, IT, 0.67), rival(2, OTHER, IT, 0.2), rival(3, OTHER, IT, 0.1)),
            "All its views are unambiguous. Three detections assigned to other objects could have been it; the most"
            " likely is that of keyframe 0 (now {1}): probability 0.67 then, dropped in keyframe 1, 7.0 nats behind the"
            " best.",
        ),
        (
            (rival(2, OTHER, IT, 0.3, log_odds=-np.inf),),
            "All its views are unambiguous. One detection assigned to another object could have been it; the most"
            " likely is that of keyframe 2 (now {1}): probability 0.30 then, dropped in keyframe 3, where nothing"
            " continued it.",
        ),
        (
            (rival(2, -1, IT, 0.3), rival(3, OTHER, IT, 0.2)),
            "All its views are unambiguous. Two detections assigned otherwise could have been it; the most likely is"
            " that of keyframe 2 (now no object): probability 0.30 then, dropped in keyframe 3, 7.0 nats behind the"
            " best.",
        ),
        (
            (rival(0, IT, OTHER, 0.67), rival(1, IT, -1, 0.2, gone=None, now=0.05, log_odds=-3.0)),
            "Two views could have been of something else; the most likely alternative is {1} in keyframe 0: probability"
            " 0.67 then, dropped in keyframe 1, 7.0 nats behind the best. The alternative that lasted longest is no"
            " object in keyframe 1: probability 0.20 then, 0.0500 now.",
        ),
    ],
)
def test_alternatives_are_counted_and_the_likeliest_is_described_with_its_end(
    explanation: Explanation, rivals: tuple[Rival, ...], expected: str
) -> None:
    own = replace(explanation.histories[0], rivals=rivals)
    names = [explanation.name_of(number) for number in (IT, OTHER)]
    assert explanation.object_id == IT and sentences(explanation, own)[2] == expected.format(*names)


@pytest.mark.parametrize(
    ("outliers", "outside", "expected"),
    [
        (np.nan, 0, "No view is outside what the class models know."),
        (np.nan, 1, "One view is outside what the class models know."),
        (0.1, 2, "No view is judged an outlier, and two are outside what the class models know."),
        (0.9, 0, "Two views are judged outliers, and none is outside what the class models know."),
    ],
)
def test_views_that_are_outliers_or_strange_to_the_class_models_are_counted(
    explanation: Explanation, outliers: float, outside: int, expected: str
) -> None:
    first, second, *_ = explanation.histories[0].views
    views = tuple(
        replace(view, outlier=outliers, in_coverage=number >= outside) for number, view in enumerate((first, second))
    )
    said = sentences(explanation, replace(explanation.histories[0], views=views))[1]
    assert said.startswith("Two views, from ") and expected in said


def test_an_object_without_views_is_what_the_map_says(explanation: Explanation) -> None:
    own = replace(explanation.histories[0], views=(), rivals=())
    assert sentences(explanation, own)[1:] == ["It was never seen: the belief about it is what the map says.", ""]


def test_a_run_without_class_models_says_nothing_of_what_they_know(explanation: Explanation) -> None:
    own = replace(explanation.histories[0], pair=None)
    said = " ".join(sentences(replace(explanation, classes=None), own))
    assert "The run has no class models." in said and "class models know" not in said
