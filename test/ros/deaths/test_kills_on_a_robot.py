"""Nodes of a live robot are killed while it drives: they come back, and what was missed is stated as uncertainty."""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import PERIOD, SPEED_M, START, Entry, map_prior, write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.live_robot import SENT, Robot, later, recorded, robot_among
from worlds.processes.node_runs import assert_same, beliefs

from semantic_slam.configuration import load_configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.geometry import transform
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.noise.odometry_noise import odometry_covariance
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.perception.frame import Detections
from semantic_slam.pipeline.assembly.frame_count import DOWN
from semantic_slam.pipeline.journal.event_journal import SESSION
from semantic_slam.pipeline.journal.segment import Segment
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.node_set import RunOptions, Sensors, robot_set

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 240
"""So many that on a busy machine a manager that is started again hears the last ones."""
MOST_LATER = 400
"""Frames that are sent after those of the drive, at most, while something is waited for."""
BACKEND_DIES, MANAGER_DIES, MANAGER_STARTS = 4, 8, 18
DAMAGED = 5
"""Keyframe whose measurements are damaged in the journal."""
EVERY_FRAME = {"policy": "odometry", "distance_m": 0.5 * SPEED_M}
"""Frames without a detection are keyframes, too."""
X, Y, YAW = 0, 1, 5


def drive() -> list[Entry]:
    """Straight ahead; from the manager's death on nothing is detected: odometry alone tells where the robot is."""
    entries = place_entries("ranges", NUM_FRAMES)
    return [_without_detections(entry) if frame_of(entry) >= MANAGER_DIES else entry for entry in entries]


def _without_detections(entry: Entry) -> Entry:
    if entry.topic != topics.DETECTIONS:
        return entry
    whole: Detections = from_message(entry.message)
    nothing = Detections(
        stamp_ns=whole.stamp_ns,
        frame_id=whole.frame_id,
        boxes=np.zeros((0, 4)),
        labels=(),
        scores=np.zeros(0),
        track_ids=(),
    )
    return replace(entry, message=to_message(nothing))


def frame_of(entry: Entry) -> int:
    return (entry.stamp_ns - START) // PERIOD


def between(entries: list[Entry], first: int, end: int) -> list[Entry]:
    return [entry for entry in entries if first <= frame_of(entry) < end]


def onward(entries: list[Entry]) -> Iterator[Entry]:
    """These, and then the last frame of them, later and later."""
    yield from entries
    for periods in range(1, 1 + MOST_LATER):
        yield from later(entries[-len(SENT) :], periods)


def missed(bag: Path) -> int:
    """Measurements that came while the manager was down, by the diagnostics in a bag."""
    return read_record(bag).dropped.get(DOWN, 0) if recorded(bag) else 0


def damage(journal: Path, keyframe: int) -> bytes:
    """Flip a bit in the measurements of a keyframe of the session; the content then."""
    segment, data = Segment(journal), bytearray(journal.read_bytes())
    places, measured = list[range](), range(0)
    while (record := segment.read()) is not None:
        if record.name == SESSION:
            places.clear()
        elif record.name == topics.MEASUREMENTS:
            measured = range(segment.num_read - Segment.size_of(*record), segment.num_read)
        elif record.name == topics.CANDIDATES:
            places.append(measured)
    segment.close()
    place = places[keyframe]
    data[(place.start + place.stop) // 2] ^= 4
    journal.write_bytes(data)
    return bytes(data)


@pytest.fixture
def configuration(tmp_path: Path) -> Path:
    nowhere = {"network": "nowhere.safetensors"}
    return write_configuration(tmp_path / "configuration", perception=nowhere, keyframes=EVERY_FRAME)


@pytest.fixture
def robot(tmp_path: Path, configuration: Path) -> Iterator[Robot]:
    prior = tmp_path / "objects.json"
    prior.write_text(map_prior().to_json())
    specs = robot_set(
        configuration,
        RunOptions(backends=2, journal=str(tmp_path / "journal"), record=str(tmp_path / "belief")),
        sensors=Sensors(has_images=False),
        map_prior=str(prior),
    )
    with robot_among(tmp_path, specs) as robot:
        yield robot


def covariance(belief: HybridBelief) -> np.ndarray:
    """(3, 3) of x, y and yaw, along the axes of map, under the likeliest hypothesis."""
    return belief.pose_covariances[belief.log_weights.argmax()][np.ix_([X, Y, YAW], [X, Y, YAW])]


def variances(belief: HybridBelief) -> np.ndarray:
    """(3,) of x, y and yaw under the likeliest hypothesis."""
    return np.diag(covariance(belief))


def predicted(before: HybridBelief, after: HybridBelief, driven: np.ndarray) -> np.ndarray:
    """(3,) variances after a motion with the variances ``driven`` (3,), which are alike along x and y."""
    x, y = (after.poses[after.log_weights.argmax()] - before.poses[before.log_weights.argmax()])[:2]
    motion = np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])
    return np.diag(motion @ covariance(before) @ motion.T) + driven


@pytest.mark.long
def test_a_backend_and_the_manager_are_killed_in_a_drive_and_what_was_missed_is_stated_as_uncertainty(
    robot: Robot, configuration: Path, tmp_path: Path
) -> None:
    entries = [entry for entry in drive() if entry.topic in SENT]
    robot.send(between(entries, -1, BACKEND_DIES))
    robot.wait_for(list(range(BACKEND_DIES)))
    robot.nodes.kill("backend_0")
    robot.send(between(entries, BACKEND_DIES, MANAGER_DIES))
    robot.wait_for(list(range(BACKEND_DIES, MANAGER_DIES)))
    robot.nodes.kill("hypothesis_manager")
    robot.send(between(entries, MANAGER_DIES, MANAGER_STARTS))
    heard = robot.send_until_heard(between(entries, MANAGER_STARTS, NUM_FRAMES), after=MANAGER_DIES - 1)
    assert heard == MANAGER_DIES
    frame = (robot.told[heard].stamp_ns - START) // PERIOD
    robot.spin_until(lambda: missed(tmp_path / "belief_2") >= frame - MANAGER_DIES)
    robot.nodes.stop()

    assert f"{MANAGER_DIES} keyframes of the journal are there again" in robot.nodes.tail("hypothesis_manager")
    live = [robot.told[keyframe] for keyframe in range(MANAGER_DIES + 1)]
    before, after = live[MANAGER_DIES - 1 :]
    assert frame >= MANAGER_STARTS
    driven_m = SPEED_M * (frame - MANAGER_DIES + 1)
    ahead = transform.between(before.poses[0], after.poses[0])
    np.testing.assert_allclose(ahead, [driven_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], atol=1e-6)
    stated = load_configuration(configuration)
    driven = np.diag(odometry_covariance(driven_m, 0.0, stated.odometry))
    assert (variances(after) >= 0.99 * predicted(before, after, driven)).all()

    bag = write_bag(tmp_path / "bag", between(drive(), -1, frame + 1))
    run_bag(bag, tmp_path / "undisturbed", stated)
    undisturbed = beliefs(tmp_path / "undisturbed")
    assert_same(live[:MANAGER_DIES], undisturbed[:MANAGER_DIES])
    assert undisturbed[-1].stamp_ns == after.stamp_ns
    assert (variances(after) > variances(undisturbed[-1])).all()

    assert missed(tmp_path / "belief_2") == frame - MANAGER_DIES


@pytest.mark.long
def test_a_manager_whose_journal_is_damaged_goes_back_and_the_other_nodes_go_back_with_it(
    robot: Robot, tmp_path: Path
) -> None:
    """The backends live on; the recorder begins another bag, and what was in the journal is kept."""
    entries = [entry for entry in drive() if entry.topic in SENT]
    robot.send(between(entries, -1, MANAGER_DIES))
    robot.wait_for(list(range(MANAGER_DIES)))
    robot.spin_until(lambda: MANAGER_DIES - 1 in recorded(tmp_path / "belief_2"))  # else it is lost with the manager
    robot.nodes.kill("hypothesis_manager")
    path, again = tmp_path / "journal" / "journal", DAMAGED - 1
    data = damage(path, DAMAGED)
    left = onward(between(entries, MANAGER_DIES, NUM_FRAMES))
    assert robot.send_until_heard(left, after=-1) == again
    robot.send_until(left, lambda: {again + 1, again + 2} <= set(robot.heard))
    robot.spin_until(lambda: again + 2 in recorded(tmp_path / "belief_3"))
    robot.nodes.stop()

    assert path.with_name("journal.damaged_000").read_bytes() == data
    log = (tmp_path / "log" / "hypothesis_manager.log").read_text()
    assert f"[hypothesis_manager]: {path}: damaged at byte" in log and f"the run goes on from keyframe {again}," in log
    assert recorded(tmp_path / "belief_2") == list(range(MANAGER_DIES))
    assert recorded(tmp_path / "belief_3")[:2] == [again + 1, again + 2]
    assert f"{tmp_path / 'belief_2'}: what it has from keyframe {again + 1} on" in robot.nodes.tail("bag_recorder")


@pytest.mark.long
def test_a_recorder_that_hears_a_restarted_manager_late_records_all_its_beliefs(robot: Robot, tmp_path: Path) -> None:
    """It is stopped while the manager is started again, so that DDS cannot match the two, as on a busy machine."""
    entries = [entry for entry in drive() if entry.topic in SENT]
    robot.send(between(entries, -1, MANAGER_DIES))
    robot.wait_for(list(range(MANAGER_DIES)))
    recorder = robot.nodes.pids()["bag_recorder"]
    os.kill(recorder, signal.SIGSTOP)
    robot.nodes.kill("hypothesis_manager")
    robot.send_until_heard(onward(between(entries, MANAGER_DIES, NUM_FRAMES)), after=MANAGER_DIES)
    os.kill(recorder, signal.SIGCONT)
    newest = max(robot.heard)
    robot.spin_until(lambda: newest in recorded(tmp_path / "belief_2"))
    robot.nodes.stop()

    keyframes = recorded(tmp_path / "belief_2")
    assert keyframes == list(range(len(keyframes)))
    assert "were lost" not in robot.nodes.tail("bag_recorder")
