"""A recorder that is not active keeps nothing but the newest of latched topics, and goes on behind the gap."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from worlds.belief_factory import small_belief
from worlds.processes.node_runs import beliefs

from semantic_slam.bag.continuation import unfinished_bag
from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import Configuration
from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.ros import bag_recorder
from semantic_slam.ros.bag_recorder import BagRecorder
from semantic_slam.ros.node import worker
from semantic_slam.ros.node.pipeline_node import PASSED
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet

pytestmark = [pytest.mark.ros, pytest.mark.slow]

TIMEOUT_S = 30.0
OPEN = replace(Configuration(), association="open")


def belief(keyframe: int) -> bytes:
    return encode(small_belief(keyframe, [1], [1], [1.0], [4], [[4]]))


def test_a_recorder_that_is_not_active_keeps_no_beliefs_and_goes_on_behind_the_gap(tmp_path: Path) -> None:
    rclpy.init(args=["--ros-args", "-p", f"bag:={tmp_path / 'bag'}", "-p", "autostart:=false"])
    try:
        recorder, robot = BagRecorder(), rclpy.create_node("robot", use_global_arguments=False)
        executor = SingleThreadedExecutor()
        executor.add_node(recorder)

        def spin_until(happened: Callable[[], bool]) -> None:
            give_up = time.monotonic() + TIMEOUT_S
            while not happened():
                assert time.monotonic() < give_up
                executor.spin_once(timeout_sec=0.02)

        said = Outlet(robot, topics.BELIEF, topics.TYPES[topics.BELIEF], qos.result(False))
        runs = Outlet(robot, topics.RUN_CONFIGURATION, topics.TYPES[topics.RUN_CONFIGURATION], qos.latched())
        assert said.wait_for_readers(1, TIMEOUT_S) and runs.wait_for_readers(1, TIMEOUT_S)

        def announced(session: int) -> str:
            run = make_run_configuration(OPEN, None, *initial_pose_of(OPEN), stamp_ns=1, session=session)
            before = recorder._newest.get(topics.RUN_CONFIGURATION)
            runs.send(encode(run))
            spin_until(lambda: recorder._newest.get(topics.RUN_CONFIGURATION) is not before)
            return run.run_id

        ids = [announced(session) for session in (0, 1)]
        for keyframe in range(3):
            said.send(belief(keyframe))
        spin_until(lambda: recorder.refused[f"{topics.BELIEF}: {PASSED}"] == 3)
        assert not recorder.worker.has_more
        recorder.resume()
        said.send(belief(5))
        spin_until(lambda: recorder._num_beliefs == 6 or recorder.fault is not None)
        recorder.worker.stop()
        recorder.close()
        assert recorder.fault is None
    finally:
        rclpy.try_shutdown()
    assert [found.keyframe for found in beliefs(tmp_path / "bag")] == [5]
    with BagReader(tmp_path / "bag") as reader:
        kept = [reader.decode(m.cdr, m.type_name).run_id for m in reader.messages([topics.RUN_CONFIGURATION])]
    assert kept == ids[1:]


def test_copies_that_overtake_beliefs_end_no_recorder_and_beliefs_that_are_lost_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rclpy.init(args=["--ros-args", "-p", f"bag:={tmp_path / 'bag'}", "-p", "autostart:=false"])
    try:
        recorder = BagRecorder()
        due = [recorder._is_due(keyframe, keyframe) for keyframe in (0, 2, 3, 1, 2, 3)]
        assert due == [True, False, False, True, True, True]
        assert recorder.refused[f"{topics.BELIEF}: out of turn"] == 2
        monkeypatch.setattr(bag_recorder, "PATIENCE_S", -1.0)
        assert not recorder._is_due(5, 5)
        with pytest.raises(SemanticSlamError, match="keyframe 5 came where 4 was due"):
            recorder._is_due(6, 6)
        recorder.worker.stop()
    finally:
        rclpy.try_shutdown()


def test_a_recorder_that_goes_on_after_a_kill_forgives_one_gap_and_no_later_one(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag")
    writer.__enter__()
    for keyframe in range(3):
        writer.write(topics.BELIEF, small_belief(keyframe, [1], [1], [1.0], [4], [[4]]), 1 + keyframe)
    writer.flush()
    given = [f"bag:={tmp_path / 'bag'}", "autostart:=false", "resume:=true"]
    rclpy.init(args=["--ros-args", *(word for item in given for word in ("-p", item))])
    try:
        recorder = BagRecorder()
        due = [recorder._is_due(keyframe, keyframe) for keyframe in (5, 6, 9, 7, 8)]
        assert due == [True, True, False, True, True]
        recorder.worker.stop()
        recorder.close()
    finally:
        rclpy.try_shutdown()


def test_a_recorder_that_ends_while_it_is_behind_leaves_a_whole_bag_and_says_what_it_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(worker, "PATIENCE_S", 0.2)
    monkeypatch.setattr(worker, "LAST_CALL_S", TIMEOUT_S)
    rclpy.init(args=["--ros-args", "-p", f"bag:={tmp_path / 'bag'}", "-p", "autostart:=false"])
    try:
        recorder = BagRecorder()

        def slowly(data: bytes) -> None:
            time.sleep(0.02)
            recorder._write(topics.BELIEF, data)

        recorder.worker.submit(lambda _: None, None)
        for keyframe in range(200):
            recorder.worker.submit(slowly, belief(keyframe))
        recorder.worker.start()
        recorder.worker.stop()
        recorder.close()
        assert recorder.fault is None
    finally:
        rclpy.try_shutdown()
    found = [found.keyframe for found in beliefs(tmp_path / "bag")]
    assert found == list(range(len(found))) and 0 < len(found) < 200
    assert f"{200 - len(found)} messages were not written" in capfd.readouterr().err


def test_a_bag_that_is_still_being_written_is_not_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for patience in ("PATIENCE_S", "LAST_CALL_S"):
        monkeypatch.setattr(worker, patience, 0.1)
    rclpy.init(args=["--ros-args", "-p", f"bag:={tmp_path / 'bag'}", "-p", "autostart:=false"])
    try:
        recorder, hangs = BagRecorder(), threading.Event()
        recorder._write(topics.BELIEF, belief(0))
        recorder._writer.flush()
        recorder.worker.submit(lambda _: hangs.wait(TIMEOUT_S), None)
        recorder.worker.start()
        recorder.worker.stop()
        recorder.close()
        assert unfinished_bag(tmp_path / "bag") and "left unfinished" in str(recorder.fault)
        hangs.set()
    finally:
        rclpy.try_shutdown()


def test_a_fault_of_writing_is_told_also_after_a_termination(tmp_path: Path) -> None:
    rclpy.init(args=["--ros-args", "-p", f"bag:={tmp_path / 'bag'}", "-p", "autostart:=false"])
    try:
        recorder = BagRecorder()
    finally:
        rclpy.try_shutdown()
    recorder._failed(RuntimeError("cannot publish"))
    assert recorder.fault is None
    recorder._failed(SemanticSlamError("no room on the disk"))
    assert str(recorder.fault) == "no room on the disk"
    recorder.close()


def test_a_belief_whose_copy_overtook_others_is_recorded_in_its_turn(tmp_path: Path) -> None:
    """In a lossless replay, where what comes again is left out."""
    given = [f"bag:={tmp_path / 'bag'}", "autostart:=false", "lossless:=true"]
    rclpy.init(args=["--ros-args", *(word for item in given for word in ("-p", item))])
    try:
        recorder = BagRecorder()
        for keyframe in (0, 2, 1, 2, 2, 0, 3):
            recorder._write(topics.BELIEF, belief(keyframe))
        assert recorder._num_beliefs == 4
        assert recorder.refused[f"{topics.BELIEF}: out of turn"] == 1
        assert recorder.repeated.total() == 2
        recorder.worker.stop()
        recorder.close()
    finally:
        rclpy.try_shutdown()
    assert [found.keyframe for found in beliefs(tmp_path / "bag")] == [0, 1, 2, 3]


def recorded(folder: Path, said: list[bytes]) -> list[list[int]]:
    """Keyframes in each bag of a live recorder that hears these beliefs."""
    rclpy.init(args=["--ros-args", "-p", f"bag:={folder / 'bag'}", "-p", "autostart:=false"])
    try:
        recorder = BagRecorder()
        for own in said:
            recorder._write(topics.BELIEF, own)
        recorder.worker.stop()
        recorder.close()
    finally:
        rclpy.try_shutdown()
    return [[found.keyframe for found in beliefs(bag)] for bag in sorted(folder.iterdir())]


def test_a_recorder_that_is_started_during_a_run_takes_the_first_belief_and_says_once_what_its_bag_lacks(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert recorded(tmp_path, [belief(keyframe) for keyframe in (36, 37, 38)]) == [[36, 37, 38]]
    (line,) = capfd.readouterr().err.splitlines()
    assert f"{tmp_path / 'bag'}: keyframes 0 to 35 were not recorded" in line and "before the run, or call ~/re" in line


def test_what_a_manager_states_anew_of_an_earlier_keyframe_goes_into_another_bag(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its journal was damaged; what is published again as it was, after any other restart, is left out."""
    later = small_belief(9, [1], [1], [1.0], [4], [[4]])
    anew = [encode(replace(later, keyframe=2)), encode(replace(later, keyframe=3, stamp_ns=later.stamp_ns + 1))]
    said = [*(belief(keyframe) for keyframe in range(5)), belief(4), belief(1), *anew]
    assert recorded(tmp_path, said) == [[0, 1, 2, 3, 4], [2, 3]]
    (line,) = capfd.readouterr().err.splitlines()
    assert f"{tmp_path / 'bag'}: what it has from keyframe 2 on is of a history that is gone" in line
    assert line.endswith(f"is recorded in {tmp_path / 'bag_2'}")
