"""Keyframes that are kept beside a journal are there again after a restart, as far as the snapshot goes."""

from dataclasses import replace
from pathlib import Path

import pytest

from semantic_slam import Configuration, Keyframe
from semantic_slam.errors import InputError
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.pipeline.journal.kept_run import KeptRun, read_kept
from semantic_slam.pipeline.journal.kept_runs import KeptRuns


def run_of(number: int) -> RunConfiguration:
    configuration = Configuration.of(association="open", semantic_model={"kind": "none"})
    run = make_run_configuration(configuration, None, *initial_pose_of(configuration), stamp_ns=1)
    return replace(run, run_id=f"{run.run_id}{number}")


def with_keyframes(kept: KeptRun, count: int) -> KeptRun:
    for index in range(kept.num_keyframes, count):
        kept.add(Keyframe.planar(index, motion=(0.1 * index, 0.0, 0.0)))
    return kept


def test_what_came_after_the_snapshot_is_kept_again(tmp_path: Path) -> None:
    first = with_keyframes(KeptRuns(tmp_path).begin(run_of(0)), 5)
    first.sync()
    length = first.length
    with_keyframes(first, 8)
    runs = KeptRuns(tmp_path)
    runs.go_on(run_of(0).run_id, length)
    again = runs.begin(run_of(0))
    assert again.num_keyframes == 5 and again.length == length and not again.fault
    with_keyframes(again, 8)
    run, keyframes = read_kept(again.descriptor, again.length)
    assert run.run_id == run_of(0).run_id
    assert [keyframe.odometry[0] for keyframe in keyframes] == pytest.approx([0.1 * index for index in range(8)])
    assert [keyframe.index for keyframe in again.keyframes(3, 6)] == [3, 4, 5]


def test_a_run_that_begins_again_without_a_snapshot_is_kept_from_its_first_keyframe(tmp_path: Path) -> None:
    with_keyframes(KeptRuns(tmp_path).begin(run_of(0)), 5)
    assert KeptRuns(tmp_path).begin(run_of(0)).num_keyframes == 0


def test_a_file_that_is_too_short_is_a_fault_and_no_wrong_keyframes(tmp_path: Path) -> None:
    first = with_keyframes(KeptRuns(tmp_path).begin(run_of(0)), 3)
    runs = KeptRuns(tmp_path)
    runs.go_on(run_of(0).run_id, first.length + 1)
    kept = runs.begin(run_of(0))
    assert "the keyframes of this run are not there again" in kept.fault
    with_keyframes(kept, 2)
    assert not kept.keyframes(0, 2)


def test_a_flipped_bit_in_a_keyframe_is_told(tmp_path: Path) -> None:
    kept = with_keyframes(KeptRuns(tmp_path).begin(run_of(0)), 3)
    (path,) = tmp_path.iterdir()
    data = bytearray(path.read_bytes())
    data[-20] ^= 1
    path.write_bytes(data)
    assert len(kept.keyframes(0, 2)) == 2
    with pytest.raises(InputError, match="are damaged"):
        kept.keyframes(0, 3)


def test_the_files_of_runs_before_the_last_two_snapshots_are_removed(tmp_path: Path) -> None:
    runs = KeptRuns(tmp_path)
    for number in range(4):
        runs.begin(run_of(number))
        runs.pass_snapshot(run_of(number).run_id)
        assert len(list(tmp_path.iterdir())) == min(number + 1, 2)


def test_without_a_folder_there_are_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runs = KeptRuns()
    assert with_keyframes(runs.begin(run_of(0)), 2).num_keyframes == 2
    runs.pass_snapshot("any")
    assert not list(tmp_path.iterdir())
