"""Objects in space that are none: a history without them is found, and weighs what it weighs when it is followed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.revision.hindsight.dissolved import dissolved, lineage_of, without
from semantic_slam.inference.revision.hindsight.proposals import Proposals
from semantic_slam.inference.revision.hindsight.reassigned import reassigned
from semantic_slam.inference.revision.hindsight.spatial import SpatialHindsight
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectEntry

ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
POINTS = np.array([[2.0, 0.0, 0.3], [2.2, 0.35, 0.25], [2.5, -0.4, 0.0], [1.8, 0.7, -0.3]])
PRIOR = GaussianPrior(np.zeros(3), np.eye(3))
RAY_SIGMA, NUM_KEYFRAMES = 0.01, 40


def walk(engine: Engine) -> None:
    """Sideways past a few points, to which there are rays alone, and back."""
    random, x = np.random.default_rng(2), ORIGIN
    for k in range(NUM_KEYFRAMES):
        motion = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.05 if k < NUM_KEYFRAMES // 2 else -0.05, 0.0]))
        x, detections = se3.compose(x, motion), []
        for point in POINTS:
            away = so3.rotated(so3.inverse(x[3:]), point - x[:3])
            ray = away / np.linalg.norm(away) + RAY_SIGMA * random.normal(size=3)
            detections.append(Detection.along(ray, ray_covariance=RAY_SIGMA**2 * np.eye(3)))
        engine.process(Keyframe.spatial(k, motion=motion, motion_covariance=1e-6 * np.eye(6), detections=detections))


def engine_of(every_keyframes: int) -> Engine:
    return Engine(
        Configuration.of(
            state_space="spatial",
            observation="points",
            association="open",
            semantic_model={"kind": "none"},
            open_world={"birth_density": 0.3, "clutter_per_frame": 0.01, "detection_probability": 0.9},
            revision={"every_keyframes": every_keyframes},
        ),
        initial_pose=ORIGIN,
        initial_covariance=1e-6 * np.eye(6),
    )


@pytest.fixture(scope="module")
def walked() -> tuple[Engine, Replay, Revised]:
    """Whose likeliest history has every point right."""
    engine = engine_of(10**6)
    walk(engine)
    association = engine.association(engine.problem, engine.registry)
    replay = Replay(engine.problem, association, engine.steps, engine.registry)
    own = replay.followed(next(iter(engine.live.values())).lineage)
    assert own is not None
    assert all(step.association == (0, 1, 2, 3) for step in own.lineage)
    return engine, replay, own


def with_one_that_is_none(engine: Engine, lineage: Lineage) -> Lineage:
    """The first sighting of one point, and one of its neighbour's, taken for one thing."""
    anew = engine.registry.first_new_id(1)
    steps = [replace(step, association=(anew, *step.association[1:])) for step in lineage]
    steps[0] = lineage[0]
    steps[2] = replace(steps[2], association=(anew, 0, *lineage[2].association[2:]))
    return tuple(steps)


@pytest.mark.long
def test_a_history_without_an_object_that_is_none_is_that_of_before(walked: tuple[Engine, Replay, Revised]) -> None:
    engine, replay, right = walked
    wrong = with_one_that_is_none(engine, right.lineage)
    followed = replay.followed(wrong)
    assert followed is not None and followed.log_joint < right.log_joint - 20.0
    found = Proposals(4, replay, engine.registry).histories(followed)
    assert found.keys() == {right.lineage}
    assert np.flatnonzero(found[right.lineage]).tolist() == [0, 2]  # where its detections were


@pytest.mark.long
def test_mistakes_that_its_neighbours_made_meanwhile_are_mended_with_it(walked: tuple[Engine, Replay, Revised]) -> None:
    """Two of them are swapped in one frame, and one is begun a second time for one frame."""
    engine, replay, right = walked
    steps = list(with_one_that_is_none(engine, right.lineage))
    steps[20] = replace(steps[20], association=(*steps[20].association[:2], 3, 2))
    steps[30] = replace(steps[30], association=(*steps[30].association[:3], engine.registry.first_new_id(30) + 3))
    followed = replay.followed(tuple(steps))
    assert followed is not None
    together, *alone = Proposals(4, replay, engine.registry).histories(followed)
    assert together == right.lineage
    assert alone and right.lineage not in alone


def test_a_frame_is_assigned_as_a_whole(walked: tuple[Engine, Replay, Revised]) -> None:
    """Two detections fit one object best: the one that has a second choice takes it; weights that differ by less than
    they are rough change nothing."""
    engine, replay, right = walked
    view = SpatialHindsight.of(replay, engine.registry, right)
    weights = [own.copy() for own in view.log_weights]
    none = weights[20][:, -1].copy()
    weights[20][2], weights[20][3] = -30.0, -30.0
    weights[20][[2, 2, 3, 3], [2, 3, 2, 3]] = [5.0, 9.0, 2.0, 7.0]
    weights[20][:, -1] = none
    assert _with(view, weights)[20].tolist() == [0, 1, 2, 3]  # 5 + 7 against 9 + 2, for which there is less
    weights[20][3, 2] = 6.0
    assert _with(view, weights)[20].tolist() == [0, 1, 2, 3]  # 12 against 15, and 2 for each that stays
    weights[20][3, 2] = 8.0
    assert _with(view, weights)[20].tolist() == [0, 1, 3, 2]
    now = _with(view, weights)
    assert all((a == b).all() for k, (a, b) in enumerate(zip(view.owners, now, strict=True)) if k != 20)


def _with(view: SpatialHindsight, weights: list[np.ndarray]) -> Sequence[np.ndarray]:
    own = replace(view)
    own.__dict__["log_weights"] = weights
    return reassigned(own).owners


def test_objects_that_are_some_are_left_alone(walked: tuple[Engine, Replay, Revised]) -> None:
    engine, replay, right = walked
    view = SpatialHindsight.of(replay, engine.registry, right)
    assert dissolved(view) == []
    assert reassigned(view).gain == 0.0
    assert Proposals(4, replay, engine.registry).histories(right) == {}
    assert lineage_of(view, view.owners) == right.lineage


def test_what_lost_is_tried_again_where_twice_as_much_speaks_for_it(
    walked: tuple[Engine, Replay, Revised], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An object that is one, of which more and more is held against it."""
    engine, replay, right = walked
    dissolving, counts = Proposals(4, replay, engine.registry), []
    for gain in (10.0, 19.0, 21.0):
        monkeypatch.setattr(
            "semantic_slam.inference.revision.hindsight.proposals.dissolved",
            lambda view, gain=gain: [replace(without(view, 0), gains=np.array([gain]))],
        )
        found = dissolving.histories(right)
        counts.append(len(found))
        for history in found:
            dissolving.note(history)
    assert counts == [1, 0, 1]


@pytest.mark.long
def test_what_the_map_has_is_never_none(walked: tuple[Engine, Replay, Revised]) -> None:
    engine, replay, right = walked
    wrong = with_one_that_is_none(engine, right.lineage)
    followed = replay.followed(wrong)
    assert followed is not None
    view = SpatialHindsight.of(replay, engine.registry, followed)
    (found,) = dissolved(view)
    number = int(view.ids[found.row])
    entry = ObjectEntry(object_id=number, name="a", prior=PRIOR, class_prior=np.ones(1))
    assert dissolved(replace(view, problem=replace(engine.problem, objects=(entry,)))) == []


@pytest.mark.long
def test_an_object_that_was_given_up_begins_anew(walked: tuple[Engine, Replay, Revised]) -> None:
    """Seen once, and then not for long: what a history names next under its number is another one."""
    engine, replay, right = walked
    late = NUM_KEYFRAMES - 5
    born = [engine.registry.first_new_id(k) for k in range(NUM_KEYFRAMES)]
    steps = [replace(step, association=(born[1], *step.association[1:])) for step in right.lineage]
    steps[0] = right.lineage[0]
    for k in range(late, NUM_KEYFRAMES):
        steps[k] = replace(steps[k], association=(0, *steps[k].association[1:]))
    strict = Replay(engine.problem, replay.association, engine.steps)
    assert strict.followed(tuple(steps)) is None
    own = replay.followed(tuple(steps))
    assert own is not None
    assert {step.association[0] for step in own.lineage[late:]} == {born[late]}


@pytest.mark.long
def test_a_run_that_looks_back_is_the_one_that_has_all_right() -> None:
    engine = engine_of(10)
    walk(engine)
    best = next(iter(engine.live.values()))
    assert all(step.association == (0, 1, 2, 3) for step in best.lineage)


def test_a_detection_far_from_all_objects_is_of_none_of_them(walked: tuple[Engine, Replay, Revised]) -> None:
    """Above the nearest of them by a dozen standard deviations, which Cauchy's tail alone forgives."""
    engine, replay, right = walked
    aside = Detection.along(np.array([1.0, -0.5, 0.3]), ray_covariance=RAY_SIGMA**2 * np.eye(3))
    view = SpatialHindsight.of(replay, engine.registry, right)
    steps = [*view.steps]
    steps[20] = engine.problem.reader.step(Keyframe.spatial(20, detections=[aside]))
    weights = replace(view, steps=steps).log_weights[20]
    assert weights.shape[0] == 1 and int(weights[0].argmax()) == len(view.ids)
