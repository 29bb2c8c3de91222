"""The study of a second session: what it changes in a room, and what it demands."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.simulation.layout import draw_layout
from semantic_slam_lab.studies.second_session.changes import CLEAR_M, changed
from semantic_slam_lab.studies.second_session.sessions import STARTS, Judged
from semantic_slam_lab.studies.second_session.study import claims_of

RIGHT = Judged(displaced=(0.98, 0.97), gone=0.95, new=0.99, wrong=0, displacement_error_m=0.03)


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
