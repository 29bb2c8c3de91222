"""Running nodes through several sessions: a pause, a bag that is played again, a reset, another map."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from semantic_slam_msgs.srv import Explain, LoadMap, SaveMap
from std_srvs.srv import SetBool, Trigger
from worlds.bags.bag_factory import write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.live_robot import SENT, Robot, later, robot_among
from worlds.processes.node_runs import assert_same, beliefs

from semantic_slam.configuration import load_configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.node.parameters import changed_parameters

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 6
PATIENCE_FRAMES = 240
"""Until a manager that is started again hears what is sent, which on a busy machine takes long."""


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    nowhere = {"network": "nowhere.safetensors"}
    configuration = load_configuration(write_configuration(tmp_path / "configuration", perception=nowhere))
    write_bag(tmp_path / "bag", place_entries("ranges", NUM_FRAMES))
    run_bag(tmp_path / "bag", tmp_path / "offline", configuration)
    configured, prior = changed_parameters(configuration), str(tmp_path / "bag" / "objects.json")
    manager = configured | {"backends": 1, "map_prior": prior, "journal": str(tmp_path / "journal")}
    specs = [
        NodeSpec("bag_recorder", "bag_recorder", {"bag": str(tmp_path / "belief")}),
        NodeSpec("hypothesis_manager_node", "hypothesis_manager", manager),
        NodeSpec("backend_node", "backend_0"),
        NodeSpec("classifier_node", "classifier", configured | {"has_images": False}),
    ]
    with robot_among(tmp_path, specs) as robot:
        yield robot


@pytest.mark.long
def test_a_robot_that_lives_through_sessions_records_each_as_a_bag_of_its_own(robot: Robot, tmp_path: Path) -> None:
    entries = place_entries("ranges", NUM_FRAMES)
    whole = list(range(NUM_FRAMES))
    robot.send(entries)
    robot.wait_for(whole)

    robot.send(entries)  # a second recording: its clock is set back
    robot.wait_for(whole)

    said = robot.ask(Trigger, "reset", Trigger.Request())
    assert said.success and "keyframe 0" in said.message
    next_entries, half = later(entries, NUM_FRAMES), 1 + len(SENT) * (NUM_FRAMES // 2)
    robot.send(next_entries[:half])
    robot.wait_for(whole[: NUM_FRAMES // 2])
    assert robot.ask(SetBool, "pause", SetBool.Request(data=True)).success
    robot.send(next_entries[half:-2])
    robot.spin(2.0)  # what is on its way belongs to the pause
    assert robot.ask(SetBool, "pause", SetBool.Request(data=False)).message == "keyframes are made"
    robot.send(next_entries[-2:])
    robot.wait_for([NUM_FRAMES // 2])

    missing = robot.ask(LoadMap, "load_map", LoadMap.Request(path=str(tmp_path / "none.json")))
    assert "none.json" in missing.fault and robot.heard == []
    path = str(tmp_path / "room.map")
    saved = robot.ask(SaveMap, "save_map", SaveMap.Request(path=path))
    loaded = robot.ask(LoadMap, "load_map", LoadMap.Request(path=path))
    assert (saved.fault, loaded.fault, loaded.objects, loaded.map_id) == ("", "", 2, saved.map_id)
    robot.send(later(entries, 2 * NUM_FRAMES))
    robot.wait_for(whole)

    robot.nodes.kill("hypothesis_manager")  # its journal knows of all that, and which session it stands in
    patience = later(place_entries("ranges", PATIENCE_FRAMES), 2 * NUM_FRAMES)[len(next_entries) :]
    assert robot.send_until_heard(patience, after=NUM_FRAMES - 1) == NUM_FRAMES
    told = robot.ask(Explain, "explain", Explain.Request(object_id=1))
    assert told.fault == "" and told.explanation.splitlines()[-1].startswith(
        "The replay reproduces the recorded beliefs"
    )

    robot.nodes.stop()
    assert [robot.nodes.exit_code(name) for name in ("bag_recorder", "hypothesis_manager", "backend_0")] == [0, 0, 0]
    reference = beliefs(tmp_path / "offline")
    bags = [tmp_path / name for name in ("belief_2", "belief_3", "belief_4", "belief_5")]
    for bag in bags[:2]:
        assert_same(beliefs(bag), reference)
    records = [read_record(bag) for bag in bags]
    assert [len(record.beliefs) for record in records[:3]] == [NUM_FRAMES, NUM_FRAMES, NUM_FRAMES // 2 + 1]
    ids = [record.run.run_id.partition(".") for record in records]
    assert [number for _, _, number in ids] == ["1", "2", "3", "4"]
    assert ids[0][0] == ids[1][0] == ids[2][0] != ids[3][0]  # the same but on another map
