"""The study of a second session: what it changes in a room, and what it demands."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.simulation.layout import draw_layout
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject
from semantic_slam_lab.studies.aliased_room.data import Recording
from semantic_slam_lab.studies.second_session.changes import CLEAR_M, Change, changed
from semantic_slam_lab.studies.second_session.sessions import STARTS, Judged, judged
from semantic_slam_lab.studies.second_session.study import claims_of

from semantic_slam.maps.differences import KINDS, MapDifference, NewObject, OldObject

RIGHT = Judged(displaced=(0.98, 0.97), gone=0.95, new=0.99, wrong=0, place_error_m=0.03)


def test_two_are_moved_one_is_gone_and_one_is_new() -> None:
    before, change = {own.object_id: own for own in draw_layout(0)}, changed(0)
    after = {own.object_id: own for own in change.objects}
    assert before.keys() - after.keys() == {change.gone} and after.keys() - before.keys() == {change.new}
    assert {n for n in before.keys() & after.keys() if before[n] != after[n]} == change.moved
    touched = [*(before[n].class_name for n in (*change.moved, change.gone)), after[change.new].class_name]
    assert len(set(touched)) == 4
    places = np.array([[own.x_m, own.y_m] for own in change.objects])
    assert (np.linalg.norm(places[:, None] - places, axis=-1) + 10.0 * np.eye(len(places))).min() > CLEAR_M


def test_a_room_is_right_with_all_four_and_nothing_else() -> None:
    rooms = {n: dict.fromkeys(STARTS, RIGHT) for n in range(10)}
    assert all(claim.holds for claim in claims_of(rooms))
    for wrong in (replace(RIGHT, gone=0.8), replace(RIGHT, wrong=1)):
        claims = claims_of({**rooms, 0: {**rooms[0], "known_start": wrong}})
        assert [claim.holds for claim in claims] == [False, True, True, True, True, True]


@pytest.mark.parametrize(("places", "wrong", "off"), [([1.0, 4.0], 0, 0.1), ([-1.0, 2.0], 2, 2.0), ([1.0], 1, None)])
def test_a_displaced_object_has_to_stand_where_it_was_moved_to(
    places: list[float], wrong: int, off: float | None
) -> None:
    """Two of three objects were moved by 1 m along x: mapped there, mapped as far the other way, and one not mapped."""
    fates = {
        n: dict.fromkeys(KINDS, 0.0) | {kind: 1.0} for n, kind in ((1, "displaced"), (2, "displaced"), (3, "gone"))
    }
    mapped = {11 + n: np.array([x, 0.1]) for n, x in enumerate(places)}
    ids = {n: 10 + n if 10 + n in mapped else None for n in fates}
    old = tuple(
        OldObject(object_id=n, name="", probabilities=own, new_id=ids[n], distance_m=1.0, sigma_m=0.1)
        for n, own in fates.items()
    )
    new = NewObject(object_id=19, name="", probability=1.0, position=np.array([5.0, 5.0]))
    told = MapDifference(old=old, new=(new,), T_old_new=np.zeros(3), same_frame=True, alignment_probability=1.0)
    objects = tuple(PlacedObject(n, "", "", x, y, 0.0) for n, x, y in ((1, 1.0, 0.0), (2, 4.0, 0.0), (9, 5.0, 5.0)))
    change = Change(objects=objects, moved=frozenset({1, 2}), gone=3, new=9)
    before = Recording(0, (), (), np.zeros((0, 3)), ("1", "2", "3"), ("", "", ""), np.zeros((3, 3)))
    found = judged(told, mapped, change, before)
    assert found.wrong == wrong and found.least == 1.0
    assert found.place_error_m == (None if off is None else pytest.approx(off, abs=0.01))


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.render
def test_the_shipped_room_is_told_apart_from_what_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["run_study", "second_session", "--quick", "--out", str(tmp_path / "out")])
    run_study.command()
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    for start in STARTS:
        assert result["summary"][start]["shipped_least_probability"] >= 0.9
        assert result["rooms"]["0"][start]["wrong"] == 0
