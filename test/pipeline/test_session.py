"""One session after the other: a bag that is played again, a pause, a run that ends where it was told to."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.bags.bag_factory import PERIOD, Entry, frame_stamp, map_prior, odometry, write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.node_runs import assert_same, beliefs

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.standard import PoseEstimate
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.pipeline.session import Session

NUM_FRAMES = 8
PAUSED = f"{topics.MEASUREMENTS}: came while the robot was paused"


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Configuration:
    nowhere = {"network": "nowhere.safetensors"}
    return load_configuration(write_configuration(tmp_path_factory.mktemp("session"), perception=nowhere))


class Pool(InProcessPool):
    """Backends, and the run that they are told of."""

    run_id = ""

    def start(self, run: RunConfiguration) -> None:
        self.run_id = run.run_id
        super().start(run)


class Played:
    """Messages into a session, and what comes out of it."""

    def __init__(self, configuration: Configuration) -> None:
        self.configuration, self.pool = configuration, Pool(1)
        self.session = Session(configuration, map_prior(), "")
        self.keyframes: list[Keyframe] = []
        self.beliefs: list[HybridBelief] = []

    def play(self, entries: list[Entry]) -> None:
        places = PlacesAssembler(self.configuration, lambda _: np.zeros(7))
        for entry in entries:
            self._take(places, entry.topic, entry.message)
            self.infer()

    def _take(self, places: PlacesAssembler, topic: str, message: Any) -> None:
        assembler = self.session.assembler
        if topic == topics.ODOMETRY:
            assembler.add_odometry(message)
        elif topic == topics.DETECTIONS:
            places.add_detections(message)
            for measured in places.take():
                assembler.add_measurements(measured)

    def infer(self, *, at_end: bool = False) -> None:
        for keyframe, belief in self.session.beliefs(self.pool, at_end=at_end):
            self.keyframes.append(keyframe)
            self.beliefs.append(belief)

    def next(self) -> None:
        former, self.session = self.session, self.session.follower(self.session.map_prior)
        self.session.assembler.go_on_from(former.assembler)
        self.keyframes, self.beliefs = [], []
        self.infer()


@pytest.fixture
def played(configuration: Configuration) -> Played:
    return Played(configuration)


def test_a_bag_that_is_played_again_is_another_session_with_the_same_beliefs(
    played: Played, configuration: Configuration, tmp_path: Path
) -> None:
    """Its first messages are refused until three of each topic agree; none of them is lost."""
    bag = write_bag(tmp_path / "bag", entries := place_entries("ranges", NUM_FRAMES))
    run_bag(bag, tmp_path / "offline", configuration)
    reference = beliefs(tmp_path / "offline")
    played.play(entries)
    assert_same(played.beliefs, reference)
    assert not played.session.assembler.is_over
    third = [n for n, entry in enumerate(entries) if entry.topic == topics.DETECTIONS][2]
    played.play(entries[:third])
    assert not played.session.assembler.is_over
    played.play(entries[third : third + 1])
    assert played.session.assembler.is_over
    played.next()
    played.play(entries[third + 1 :])
    assert_same(played.beliefs, reference)
    assert played.session.number == 1 and not played.session.dropped


def test_a_player_that_goes_over_its_last_messages_again_begins_no_session(played: Played) -> None:
    """Started again, it begins some frames before the newest one; they are dropped, and the run goes on."""
    entries = place_entries("ranges", 20)
    played.play(entries)
    half = len(entries) // 2
    played.play(entries[half:])
    assert not played.session.assembler.is_over and len(played.beliefs) == 20


def test_odometry_alone_that_is_set_back_begins_no_session(played: Played) -> None:
    entries = place_entries("ranges", NUM_FRAMES)
    played.play(entries)
    played.play([entry for entry in entries if entry.topic == topics.ODOMETRY])
    assert not played.session.assembler.is_over
    assert "its clock was set back" in next(iter(played.session.dropped))


def test_while_paused_no_keyframe_is_made_and_the_motion_of_the_pause_is_in_the_next_one(played: Played) -> None:
    """Forty metres there and back within the pause: the robot is where it was, and less sure of it."""
    entries = place_entries("ranges", NUM_FRAMES)
    first, rest = entries[: len(entries) // 2], entries[len(entries) // 2 :]
    played.play(first)
    before, last_m = len(played.beliefs), 0.1 * (len(played.beliefs) - 1)
    played.session.assembler.is_paused = True
    stamp_ns = first[-1].stamp_ns
    tour = [last_m + 20.0, last_m]
    for n, x in enumerate(tour):
        sample = odometry(stamp_ns + (n + 1) * PERIOD // 100, x)
        played.session.assembler.add_odometry(to_message(sample))
    played.play(rest[: len(rest) // 2])
    assert len(played.beliefs) == before and played.session.dropped[PAUSED] > 0
    played.session.assembler.is_paused = False
    played.play(rest[len(rest) // 2 :])
    after = played.keyframes[before]
    straight = played.keyframes[before - 1].odometry_covariance
    assert after.index == before and after.stamp_ns > frame_stamp(before)
    assert after.odometry_covariance[0, 0] > 100.0 * straight[0, 0]


def test_a_pose_that_comes_during_a_run_is_where_the_next_one_begins(played: Played) -> None:
    played.play(place_entries("ranges", NUM_FRAMES))
    played.session.set_initial_pose(pose_at(5.0))
    played.session = played.session.follower(played.session.map_prior)
    played.beliefs = []
    played.play(place_entries("ranges", NUM_FRAMES))
    assert played.beliefs[0].keyframe == 0 and abs(played.beliefs[0].poses[0, 0] - 5.0) < 0.5


def test_a_pose_that_comes_before_the_first_keyframe_is_where_this_run_begins(played: Played) -> None:
    """Though the run before was told, too, where the next one begins."""
    played.play(place_entries("ranges", NUM_FRAMES))
    played.session.set_initial_pose(pose_at(5.0))
    played.session = played.session.follower(played.session.map_prior)
    for x in (3.0, 9.0):  # the first one counts
        played.session.set_initial_pose(pose_at(x))
    played.beliefs = []
    played.play(place_entries("ranges", NUM_FRAMES))
    assert abs(played.beliefs[0].poses[0, 0] - 3.0) < 0.5


def pose_at(x: float) -> PoseEstimate:
    return PoseEstimate(0, "map", np.array([x, 0, 0, 0, 0, 0, 1]), 1e-4 * np.eye(6))


@pytest.mark.parametrize("kind", ["gp_independent", "detector"])
def test_before_the_first_keyframe_a_map_that_cannot_be_is_refused_and_another_one_is_not(kind: str) -> None:
    default = Configuration()
    session = Session(replace(default, semantic_model=replace(default.semantic_model, kind=kind)), None, "")
    named = [replace(box, class_probabilities={"no such class": 1.0}) for box in map_prior().objects]
    session.check(map_prior())
    with pytest.raises(InputError, match="there is no map prior"):
        session.check(MapPrior())
    if kind == "detector":  # whose classes are what the map says, too
        session.check(MapPrior(tuple(named)))
        return
    with pytest.raises(InputError, match="unknown class 'no such class'"):
        session.check(MapPrior(tuple(named)))


def test_sessions_have_ids_of_their_own_and_a_map_that_cannot_be_is_refused(played: Played) -> None:
    entries = place_entries("ranges", NUM_FRAMES)
    ids = []
    for _ in range(2):
        played.play(entries)
        ids.append(played.pool.run_id)
        played.session = played.session.follower(played.session.map_prior)
    assert ids[1] == f"{ids[0]}.1"
    played.play(entries)
    with pytest.raises(InputError, match="there is no map prior"):
        played.session.check(replace(map_prior(), objects=()))
