"""Bags with topic imu: in space roll and pitch do not drift, and a planar run does as if it were not there."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.simulation.tables import T_BODY_CAMERA, Flight, TableTops, table_tops
from semantic_slam_lab.studies.tables.run import configuration
from worlds.bags.bag_factory import Entry, frame_stamp, input_entries, without, write_bag, write_configuration
from worlds.bags.imported import read_bag
from worlds.bags.table_bag import SLOW_S, in_space, with_imu, write_table_bag
from worlds.processes.commands import call
from worlds.scenes.inertial import Imu

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import load_configuration
from semantic_slam.geometry import so3
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.inertial import imu_message
from semantic_slam.messages.standard import PoseEstimate
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.pipeline.recorded_keyframes import recorded_keyframes

DRIFT_RAD = 0.015
"""Of roll and of pitch from keyframe to keyframe, of odometry that feels no gravity."""
COUNT = 14
OWN = replace(in_space(), odometry=replace(in_space().odometry, level_repeats_s=SLOW_S))
SENSORS = {"accelerations": None, "orientations": 0.01}
"""How well each states its orientation [rad]; None: it states none."""


@dataclass(frozen=True)
class Tilt:
    """Of the robot at the end of a flight."""

    error_rad: float
    sigma_rad: float  # of roll and pitch together


def entries_of(room: TableTops, sensor: str) -> list[Entry]:
    return with_imu(
        room, Imu(T_body_imu=T_BODY_CAMERA, tilt_rad=SENSORS[sensor], rate_hz=50.0), np.random.default_rng(9)
    )


def blind(room: TableTops) -> list[Entry]:
    """Without a sensor; somebody tells how the camera is tilted at the start."""
    entries = without(entries_of(room, "accelerations"), topics.IMU)
    first_ns = entries[0].stamp_ns
    start = PoseEstimate(first_ns, "map", np.append(np.zeros(3), room.truth[0, 3:]), 1e-4 * np.eye(6))
    return [Entry(topics.INITIAL_POSE, to_message(start), first_ns), *entries]


def tilt_of(belief: HybridBelief, true: np.ndarray) -> Tilt:
    cosine = so3.matrix(belief.poses[0, 3:])[2] @ so3.matrix(true[3:])[2]
    return Tilt(float(np.arccos(min(cosine, 1.0))), float(np.sqrt(np.trace(belief.pose_covariances[0][3:5, 3:5]))))


@pytest.fixture(scope="module")
def rooms() -> list[TableTops]:
    region = SpatialRegion.of(configuration().open_world)
    flight = Flight(keyframes=COUNT, things=5, gravity_rad=DRIFT_RAD)
    return [table_tops(flight, region, np.random.default_rng(seed)) for seed in range(2)]


@pytest.fixture(scope="module")
def flown(rooms: list[TableTops], tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Path]]:
    """Belief bags of both rooms: by each sensor, and by none."""
    folder = tmp_path_factory.mktemp("flights")
    makers = {"none": blind} | {sensor: partial(entries_of, sensor=sensor) for sensor in SENSORS}
    found: dict[str, list[Path]] = {name: [] for name in makers}
    for name, entries_of_room in makers.items():
        for number, room in enumerate(rooms):
            out = folder / f"{name}_{number}"
            summary = run_bag(write_table_bag(folder / f"{name}_bag_{number}", entries_of_room(room)), out, OWN)
            assert not any(reason.startswith("imu") for reason in summary.dropped)
            found[name].append(out)
    return found


def tilts(bags: list[Path], rooms: list[TableTops]) -> list[Tilt]:
    return [tilt_of(read_bag(bag)[topics.BELIEF][-1], room.truth[-1]) for bag, room in zip(bags, rooms, strict=True)]


@pytest.mark.long
@pytest.mark.parametrize("sensor", SENSORS)
def test_roll_and_pitch_do_not_drift(rooms: list[TableTops], flown: dict[str, list[Path]], sensor: str) -> None:
    """From a start at which the camera looks down by some twenty degrees, which nobody tells but the sensor."""
    felt, unfelt = tilts(flown[sensor], rooms), tilts(flown["none"], rooms)
    assert max(tilt.error_rad for tilt in felt) < 0.03
    assert all(tilt.error_rad < 3.0 * tilt.sigma_rad for tilt in felt)
    assert max(tilt.sigma_rad for tilt in felt) < 0.6 * min(tilt.sigma_rad for tilt in unfelt)


@pytest.mark.long
def test_one_bad_second_at_the_start_does_not_cost_gravity(rooms: list[TableTops], tmp_path: Path) -> None:
    """The first 0.7 s are zeros, as of a driver that warms up; the tilt at the start is then known to 0.5 rad."""
    entries = entries_of(rooms[0], "accelerations")
    first_ns = min(entry.stamp_ns for entry in entries if entry.topic == topics.IMU)
    for entry in entries:
        if entry.topic == topics.IMU and entry.stamp_ns < first_ns + 700_000_000:
            entry.message.linear_acceleration.x = entry.message.linear_acceleration.y = 0.0
            entry.message.linear_acceleration.z = 0.0
    run_bag(write_table_bag(tmp_path / "bag", entries), tmp_path / "out", OWN)
    first, *_, last = read_bag(tmp_path / "out")[topics.BELIEF]
    begun, ended = tilt_of(first, rooms[0].truth[0]), tilt_of(last, rooms[0].truth[-1])
    assert begun.sigma_rad > 0.3 and begun.error_rad < 3.0 * begun.sigma_rad
    assert ended.error_rad < 0.03 and ended.sigma_rad < 0.1


def test_a_report_of_such_a_bag_is_level(rooms: list[TableTops], flown: dict[str, list[Path]], tmp_path: Path) -> None:
    words = (flown["accelerations"][0], "--out", tmp_path / "out")
    assert call(tmp_path, "semantic_slam.cli.bag_to_report", *words).returncode == 0
    *_, last = (tmp_path / "out" / "trajectory.tum").read_text().splitlines()
    turn = np.array(last.split()[4:], dtype=np.float64)
    assert so3.matrix(turn)[2] @ so3.matrix(rooms[0].truth[-1, 3:])[2] > np.cos(0.03)


def test_keyframes_of_a_recorded_run_are_as_level_as_its_own(
    rooms: list[TableTops], flown: dict[str, list[Path]]
) -> None:
    """Else what replays a run, to explain it, would replay another."""
    levels = [keyframe.level for keyframe in recorded_keyframes(flown["orientations"][0], OWN, COUNT)]
    assert len(levels) == COUNT
    for level, true in zip(levels, rooms[0].truth, strict=True):
        assert level is not None and level[:3] @ so3.matrix(true[3:])[2] > np.cos(0.05)


def test_a_planar_run_ignores_it_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own, entries = load_configuration(write_configuration(tmp_path)), input_entries(4)
    felt = [
        Entry(topics.IMU, imu_message(frame_stamp(k), "base_link", np.array([0.0, 5.0, 8.0])), frame_stamp(k))
        for k in range(4)
    ]
    told = {}
    for name, messages in (("without", entries), ("with", [*entries, *felt])):
        bag = write_bag(tmp_path / name, sorted(messages, key=lambda entry: entry.stamp_ns))
        run_bag(bag, tmp_path / f"{name}_belief", own)
        assert ("/imu is not used: a planar robot is level" in capsys.readouterr().out) == (name == "with")
        with BagReader(tmp_path / f"{name}_belief") as reader:
            told[name] = [(message.topic, message.cdr) for message in reader.messages([topics.BELIEF, topics.IMU])]
    assert told["with"] == told["without"] and len(told["with"]) == 4
