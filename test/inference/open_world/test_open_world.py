"""A run without a map: the right objects come to exist, false alarms do not, however the work is divided."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from worlds.drives.open_room import OBJECTS, Room, make_room
from worlds.same_beliefs import assert_same

from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

NEAR_M = 0.3
ROUND = 25
"""Keyframes in which the robot turns once."""


def run(room: Room, num_backends: int = 1) -> tuple[Engine, list[HybridBelief]]:
    manager = Engine.of_run(room.run, InProcessPool(num_backends))
    return manager, [manager.process(keyframe) for keyframe in room.keyframes]


def seen_objects(room: Room) -> list[int]:
    """Objects that were detected three times at least."""
    seen = [n for frame in room.associations for n in frame]
    return [n for n in range(len(OBJECTS)) if seen.count(n) >= 3]


def distances(belief: HybridBelief) -> np.ndarray:
    """(O, N) from the objects of the belief to the true ones."""
    return np.linalg.norm(belief.object_poses[:, None, :2] - OBJECTS[:, :2], axis=-1)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_objects_exist_and_false_alarms_do_not(seed: int) -> None:
    room = make_room(50, seed=seed, clutter=0.15)
    belief = run(room)[1][-1]
    away = distances(belief)
    for number in seen_objects(room):
        assert belief.existence[away[:, number] < NEAR_M].max(initial=0.0) > 0.9
    looked_at_again = belief.object_ids < sum(len(frame) for frame in room.associations[:-ROUND])
    ghosts = belief.existence[looked_at_again & (away.min(axis=1) > 2.0 * NEAR_M)]
    assert (ghosts < 0.5).all()
    assert np.hypot(*(belief.poses[0, :2] - room.truth[-1, :2])) < 0.3
    assert 0.0 <= belief.discarded_mass < 0.5
    assert belief.reproducible


def test_detections_of_one_object_share_an_id() -> None:
    room = make_room(30, seed=1, clutter=0.15)
    manager, _ = run(room)
    best = max(manager.live, key=lambda n: manager.live[n].log_weight)
    found: dict[int, set[int]] = {}
    for step, labels in zip(manager.live[best].lineage, room.associations, strict=True):
        for number, label in zip(step.association, labels, strict=True):
            found.setdefault(number, set()).add(label)
    tracked = [labels for labels in found.values() if labels != {-1}]
    assert sorted(label for labels in tracked for label in labels) == seen_objects(room)  # one id for each, no more


@pytest.mark.parametrize("iterates", [True, False])
def test_a_child_that_is_lost_takes_no_other_along(iterates: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    room = make_room(12, seed=0, open_world={"merge_position_m": 0.0, "iterate_updates": iterates})
    manager = Engine.of_run(room.run, InProcessPool(1))
    child, given_up = Component.child, []

    def breaks_once(component: Component, *arguments: Any, **options: Any) -> Component:
        if len(manager.live) > 1 and not given_up:
            given_up.append(component.keyframe)
            raise LostComponentError("not finite")
        return child(component, *arguments, **options)

    monkeypatch.setattr(Component, "child", breaks_once)
    for keyframe in room.keyframes:
        manager.process(keyframe)
    assert given_up
    assert manager.lost == {"hypothesis lost: not finite": 1}


@pytest.mark.parametrize("semantic", [False, True])
def test_the_number_of_backends_changes_nothing(semantic: bool) -> None:
    room = make_room(12, seed=0, semantic=semantic, open_world={"merge_position_m": 0.0})
    _, single = run(room)
    _, divided = run(room, 2)
    assert max(len(belief.hypothesis_ids) for belief in single) > 1
    for first, second in zip(single, divided, strict=True):
        assert_same(first, second)


@pytest.mark.long
@pytest.mark.slow
def test_a_lineage_is_rebuilt_as_it_was() -> None:
    room = make_room(14, seed=0)
    manager = Engine.of_run(room.run, ForgetfulPool(2))
    for keyframe, expected in zip(room.keyframes, run(room)[1], strict=True):
        assert_same(manager.process(keyframe), expected)


def test_classes_come_with_the_objects() -> None:
    room = make_room(24, seed=3, clutter=0.05, semantic=True)
    belief = run(room)[1][-1]
    away = distances(belief)
    for number in seen_objects(room):
        rows = np.flatnonzero((away[:, number] < NEAR_M) & (belief.existence > 0.5))
        assert len(rows) == 1
        assert belief.class_probabilities[rows[0], number % 2] > 0.9


def test_a_map_prior_and_an_open_world_go_together() -> None:
    """Two objects are on the map, a third one that is not there goes, and the others come."""
    covariance = covariance_from_planar(np.diag([0.01, 0.01, 0.01]))
    ghost = np.array([4.0, 0.0, 0.0])
    poses = [OBJECTS[0], OBJECTS[1], ghost]
    objects = tuple(
        ObjectPrior(
            object_id=n,
            name=f"thing_{n}",
            pose=pose_vector_from_planar(pose),
            covariance=covariance,
            class_probabilities={},
            existence=0.8,
        )
        for n, pose in enumerate(poses)
    )
    room = make_room(24, seed=4, clutter=0.1, map_prior=MapPrior(objects))
    belief = run(room)[1][-1]
    names = dict(zip(belief.object_names, belief.existence, strict=True))
    assert names["thing_0"] > 0.95
    assert names["thing_1"] > 0.95
    assert names.get("thing_2", 0.0) < 0.1
    assert (belief.object_ids > 2).any()


def test_what_a_wall_hides_is_not_missed() -> None:
    """Nothing is detected where the map has an object; the depth image shows a wall in front of it, or open space."""
    covariance = covariance_from_planar(np.diag([0.01, 0.01, 0.01]))
    ghost = ObjectPrior(
        object_id=0,
        name="ghost",
        pose=pose_vector_from_planar(np.array([4.0, 0.0, 0.0])),
        covariance=covariance,
        class_probabilities={},
        existence=0.8,
    )
    room = make_room(1, map_prior=MapPrior((ghost,)))
    directions = np.linspace(-0.7, 0.7, 20)
    left: dict[float, float] = {}
    for wall_m in (1.0, 5.0):
        free_range_scan = np.column_stack([directions, np.full(20, wall_m)])
        frame = dataclasses.replace(room.keyframes[0].measurements, free_range_scan=free_range_scan)
        keyframe = dataclasses.replace(room.keyframes[0], measurements=frame)
        belief = Engine.of_run(room.run, InProcessPool(1)).process(keyframe)
        left[wall_m] = float(belief.existence[0])
    assert left[1.0] == pytest.approx(0.8)
    assert left[5.0] < 0.4


@pytest.mark.long
@pytest.mark.slow
def test_near_copies_merge_and_are_counted() -> None:
    room = make_room(32, seed=0, clutter=0.3)
    _, merged = run(room)
    _, all_of_them = run(make_room(32, seed=0, clutter=0.3, open_world={"merge_position_m": 0.0}))
    assert sum(belief.num_merged for belief in merged) > 0
    assert sum(belief.num_merged for belief in all_of_them) == 0
    kept, without = (sum(len(belief.hypothesis_ids) for belief in beliefs) for beliefs in (merged, all_of_them))
    assert kept < without


def test_a_time_budget_marks_the_belief() -> None:
    room = make_room(6, seed=0, open_world={"time_budget_ms": 1e-3, "merge_position_m": 0.0})
    _, beliefs = run(room)
    assert not any(belief.reproducible for belief in beliefs)
    assert all(len(belief.hypothesis_ids) == 1 for belief in beliefs[1:])


def test_of_a_long_drive_fewer_hypotheses_are_followed() -> None:
    room = make_room(6, seed=0, clutter=0.3, open_world={"merge_position_m": 0.0}, pruning={"max_poses": 6})
    _, beliefs = run(room)
    assert [len(belief.hypothesis_ids) <= 6 // number for number, belief in enumerate(beliefs, start=1)] == [True] * 6
    assert all(belief.reproducible for belief in beliefs)


def test_what_cannot_work_is_refused() -> None:
    with pytest.raises(InputError, match="min_range_m"):
        make_room(1, open_world={"min_range_m": 9.0})
    with pytest.raises(InputError, match="distinct_assignment"):
        make_room(1, distinct_assignment=False)
