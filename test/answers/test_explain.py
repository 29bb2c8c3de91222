"""Why a map believes something: an account that adds up to what was recorded, whatever the class models are."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from worlds.scenes.planar_world import make_world

from semantic_slam.answers.explain.explanation import compared_classes, explanation_of
from semantic_slam.answers.explain.ledger import class_ledger, histories
from semantic_slam.answers.explain.replayed_run import SAME_NATS, ReplayedRun, ancestors, replay
from semantic_slam.answers.explain.text import lines_of
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.maps.from_run import saved_map_of_run

PLACES = {"a": (3.0, -1.0), "b": (3.0, 1.0), "c": (4.0, 0.0)}
WORDS = (
    {"a": "chair", "b": "cup"},
    {"a": "chair", "b": "cup", "c": "tv"},
    {"a": "cup", "b": "cup", "c": "tv"},
    {"b": "chair"},
    {"a": "chair", "c": "tv"},
)
NO_TRACK = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))


@dataclass(frozen=True)
class Recorded:
    """A run as a belief bag holds it, and its replay."""

    record: Record
    keyframes: list[Keyframe]
    run: ReplayedRun


def recorded(run: RunConfiguration, keyframes: Sequence[Keyframe]) -> Recorded:
    engine = Engine.of_run(run, InProcessPool(2))
    beliefs = tuple(engine.process(keyframe) for keyframe in keyframes)
    measurements = {keyframe.stamp_ns: keyframe.measurements for keyframe in keyframes}
    record = Record(run, beliefs, NO_TRACK, measurements, None)
    return Recorded(record, list(keyframes), replay(record, keyframes, beliefs[-1].object_ids.tolist()))


def of_world(num_keyframes: int = 4, **overrides) -> Recorded:
    world = make_world(num_keyframes, **overrides)
    return recorded(world.run, world.keyframes)


def of_words(association: str) -> Recorded:
    """A robot that drives past three objects that a detector names, now and then wrongly."""
    own = Configuration.of(
        association=association, semantic_model={"kind": "detector", "labels": ["chair", "cup", "tv"]}
    )
    keyframes = [
        Keyframe.planar(
            index,
            motion=(0.3 if index else 0.0, 0.0, 0.0),
            detections=[
                Detection.at(PLACES[name][0] - 0.3 * index, PLACES[name][1], label=word, track_id=name, score=0.7)
                for name, word in words.items()
            ],
        )
        for index, words in enumerate(WORDS)
    ]
    return recorded(make_run_configuration(own, None, *initial_pose_of(own), stamp_ns=0), keyframes)


RUNS = {
    "parametric": lambda: of_world(semantic_model={"kind": "parametric"}),
    "gp_independent": lambda: of_world(semantic_model={"kind": "gp_independent"}),
    "gp_correlated": lambda: of_world(semantic_model={"kind": "gp_correlated"}),
    "class tables": lambda: of_world(association="open", semantic_model={"kind": "parametric"}),
    "detector": lambda: of_words("given"),
    "detector, open": lambda: of_words("open"),
}


def recorded_log_odds(told: Recorded, k: int, number: int, object_id: int, one: int, other: int) -> float:
    """From the recorded belief alone, over all hypotheses with the associations that one of them has had so far."""
    belief, live = told.record.beliefs[k], told.run.keyframes[k].live
    same = [live[n].history == live[number].history for n in belief.hypothesis_ids.tolist()]
    row = belief.object_ids.tolist().index(object_id)
    mass = np.exp(belief.log_weights[same]) @ belief.hypothesis_class_probabilities[same, row]
    return float(np.log(mass[one]) - np.log(mass[other]))


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow) if "gp" in kind else kind for kind in RUNS]
)
def test_prior_views_and_what_was_revised_add_up_to_the_recorded_log_odds(kind):
    told = RUNS[kind]()
    assert told.run.largest_difference < SAME_NATS
    compared = 0
    for members in histories(told.run)[:3]:
        for object_id in told.record.beliefs[-1].object_ids.tolist():
            ledger = class_ledger(told.run, object_id, members)
            for one, other in permutations(range(len(ledger.log_prior)), 2):
                pair = ledger.pair(one, other)
                assert pair.total == pytest.approx(pair.log_odds, abs=1e-6)
                if pair.until >= 0 and object_id in told.record.beliefs[pair.until].object_ids:
                    number = ancestors(told.run.keyframes, members[0])[pair.until]
                    exact = recorded_log_odds(told, pair.until, number, object_id, one, other)
                    assert pair.total == pytest.approx(exact, abs=1e-6)
                    compared += 1
    assert compared >= 10


@pytest.mark.parametrize("kind", ["parametric", pytest.param("gp_independent", marks=pytest.mark.slow)])
def test_what_the_weights_say_of_a_view_is_what_its_likelihood_says(kind):
    kept = {"pruning": {"ratio": 1e12, "max_hypotheses": 200}}
    told = of_world(3, sigma_start_m=0.05, semantic_model={"kind": kind}, **kept)
    ledger = class_ledger(told.run, 0, histories(told.run)[0])
    one, other = compared_classes(ledger)
    pair = ledger.pair(one, other)
    alone = ledger.alone[:, one] - ledger.alone[:, other]
    known = np.isfinite(pair.views)
    assert known.sum() >= 2 and np.abs(alone[known]).max() > 1.0
    np.testing.assert_allclose(pair.views[known], alone[known], atol=0.2)
    assert abs(pair.revised) < 0.1


def test_an_alternative_ends_where_recorded_beliefs_have_it_no_more():
    told = of_world(8, semantic_model={"kind": "none"})
    answers = [explanation_of(told.record, told.run, n) for n in told.record.beliefs[-1].object_ids.tolist()]
    found = [rival for answer in answers for rival in answer.histories[0].rivals if rival.object_id >= 0]
    assert found and all(rival.gone is not None and rival.now == 0.0 for rival in found)
    for rival in found:
        alive, last = frozenset[int](), -1
        for belief in told.record.beliefs[rival.keyframe :]:
            ids = belief.hypothesis_ids
            if belief.keyframe == rival.keyframe:
                row = belief.object_ids.tolist().index(rival.object_id)
                rows = belief.associations[:, rival.detection] == row
            else:
                rows = np.isin(belief.parent_ids, list(alive))
            alive = frozenset(ids[rows].tolist())
            if not alive:
                break
            last = belief.keyframe
        assert rival.gone == max(last + 1, rival.keyframe)
        assert rival.log_odds < -np.log(told.run.problem.pruning.ratio) or not np.isfinite(rival.log_odds)


@pytest.mark.slow
def test_a_history_that_was_revised_is_told_as_it_ended():
    overrides = {
        "open_world": {"iterate_updates": False},
        "revision": {"every_keyframes": 2, "lost_every_keyframes": 2},
        "semantic_model": {"kind": "detector", "labels": ["object"]},
    }
    told = of_world(8, seed=2, association="open", **overrides)
    members = next(own for own in histories(told.run) if own[0] in told.run.revised)
    belief, number = told.record.beliefs[-1], members[0]
    seen = 0
    for row, object_id in enumerate(belief.object_ids.tolist()):
        ledger = class_ledger(told.run, object_id, members)
        pair = ledger.pair(0, 1)
        exact = belief.hypothesis_class_probabilities[belief.hypothesis_ids.tolist().index(number), row]
        assert pair.total == pytest.approx(np.log(exact[0] / exact[1]), abs=1e-6)
        assert np.isfinite(pair.views[ledger.is_view]).all()
        seen += int(ledger.is_view.sum())
    assert seen > 8 and told.run.is_same


def test_a_view_that_no_class_explains_is_judged_an_outlier():
    no_clutter = {"closed_world": {"clutter_per_frame": 0.0}}
    world = make_world(5, sigma_start_m=0.1, semantic_model={"kind": "parametric"}, **no_clutter)
    keyframes = list(world.keyframes)
    features = keyframes[3].measurements.features.copy()
    features[0] += 5.0
    keyframes[3] = replace(keyframes[3], measurements=replace(keyframes[3].measurements, features=features))
    told = recorded(world.run, keyframes)
    views = explanation_of(told.record, told.run, world.associations[3][0]).histories[0].views
    assert {view.keyframe: view.outlier > 0.5 for view in views}[3]
    assert not any(view.outlier > 0.5 for view in views if view.keyframe != 3)


@pytest.mark.parametrize("name", ["a", "c"])
def test_the_names_of_earlier_objects_are_the_class_prior_of_a_new_one(name):
    """What comes first is as any object; what comes later is beside a chair and a cup, of which no view tells."""
    told = RUNS["detector"]()
    last = told.record.beliefs[-1]
    number = int(last.object_ids[last.object_names.index(name)])
    ledger = class_ledger(told.run, number, histories(told.run)[0])
    shares = np.exp(ledger.log_prior - told.run.log_class_prior[number])
    assert np.allclose(shares, 1.0) == (name == "a")
    first = int(np.flatnonzero(ledger.is_view)[0])
    said = ledger.evidence[first] - ledger.evidence[first].mean()
    np.testing.assert_allclose(said, ledger.alone[first] - ledger.alone[first].mean(), atol=1e-9)


def test_a_replay_that_differs_says_so():
    told = RUNS["detector"]()
    last = told.record.beliefs[-1]
    changed = replace(last, log_weights=last.log_weights + 1e-3)
    other = replace(told.record, beliefs=(*told.record.beliefs[:-1], changed))
    run = replay(other, told.keyframes, [0])
    assert run.largest_difference == pytest.approx(1e-3) and not run.is_same
    assert "differs from the recorded beliefs by up to 1.0e-03 nats" in lines_of(explanation_of(other, run, 0))[-1]


def test_a_run_that_cannot_be_repeated_is_an_error_with_a_remedy():
    told = RUNS["detector"]()
    first = told.record.beliefs[0]
    strange = replace(first, hypothesis_ids=first.hypothesis_ids + np.uint64(1))
    other = replace(told.record, beliefs=(strange, *told.record.beliefs[1:]))
    with pytest.raises(InputError, match=r"keyframe 0: .*not those recorded; explain with the version"):
        replay(other, told.keyframes, [0])
    with pytest.raises(InputError, match=r"keyframe 4: .*not those recorded"):
        replay(told.record, told.keyframes[:-1], [0])


@pytest.mark.parametrize("observation", ["points", "range_bearing"])
def test_views_in_space_are_from_where_the_camera_is_above_the_object(observation):
    """A camera that looks 45 degrees down, mounted 0.5 m ahead of the body, whose tilt lowers it: by hand, in map.

    A body starts with a heading that nobody has measured, so that directions are off the x axis of map, too.
    """
    tilt, mounting = Rotation.from_euler("y", 45.0, degrees=True), np.array([0.5, 0.0, 0.0])
    own = Configuration.of(
        association="open",
        observation=observation,
        state_space="spatial",
        semantic_model={"kind": "detector", "labels": ["chair", "cup", "tv"]},
        open_world={"field_of_view_rad": 1.4, "vertical_field_of_view_rad": 1.2},
        initial_pose={"mean": [0.0, 0.0, 0.0, 0.0, np.pi / 4.0, 0.0], "sigma": [0.01] * 6},
    )
    place, keyframes, cameras = np.array([2.0, 0.0, -2.0]), [], []
    for k in range(4):
        cameras.append(np.array([0.0, 0.3 * k, 0.0]) + tilt.apply(mounting))
        seen = tilt.inv().apply(place - cameras[-1])
        motion = np.array([0.0, 0.3 if k else 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        level = np.append(mounting, [0.0, 0.0, 0.0, 1.0])
        detections = [Detection.in_space(seen, T_body_sensor=level, label="chair", score=0.7)]
        optical = np.append(mounting, [-0.5, 0.5, -0.5, 0.5])
        keyframes.append(Keyframe.spatial(k, motion=motion, detections=detections, T_body_camera=optical))
    told = recorded(make_run_configuration(own, None, *initial_pose_of(own), stamp_ns=0), keyframes)
    explained = explanation_of(told.record, told.run, int(told.record.beliefs[-1].object_ids[0]))
    views = explained.histories[0].views
    assert len(views) == 4 and not any(view.from_front for view in views)
    expected = np.array(cameras) - place
    np.testing.assert_allclose([v.range_m for v in views], np.linalg.norm(expected, axis=1), atol=0.05)
    azimuths = np.arctan2(expected[:, 1], expected[:, 0])
    off = [v.direction_rad for v in views] - azimuths
    np.testing.assert_allclose(np.angle(np.exp(1j * off)), 0.0, atol=0.05)
    assert "off the x axis of map" in "\n".join(lines_of(explained))


def test_a_bag_whose_recorder_was_started_during_the_run_is_not_said_to_be_of_another_version():
    told = of_world()
    late = replace(told.record, beliefs=told.record.beliefs[2:])
    keyframes = [replace(keyframe, index=n) for n, keyframe in enumerate(told.keyframes[2:])]
    with pytest.raises(InputError, match=r"begins with keyframe 2, .* ask ~/explain of the running manager"):
        replay(late, keyframes, ())
    with pytest.raises(InputError, match=r"begins with keyframe 2, .* save with --marginals"):
        saved_map_of_run(late, keyframes)
    assert replay(late, told.keyframes, ()).is_same  # where all that was measured is there, beliefs may be missing
