"""The launch file of a live robot, as far as it can be checked where ``launch`` is not installed, and its node set."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from worlds.bags.bag_factory import input_entries, write_bag, write_configuration

from semantic_slam.errors import InputError
from semantic_slam.ros.launching.node_set import NodeSpec, RunOptions, Sensors, node_set, robot_set

REQUIRED = {"config", "journal"}
OPTIONAL = {"map_prior": "", "backends": "2", "record": "", "overwrite": "false", "resume": "false", "remap": ""}
OPTIONAL |= {"has_images": "true", "has_depth": "true", "has_imu": "false", "detections_type": ""}
OPTIONAL |= {"has_moving_camera": "false", "odom_frame": "", "map_frame": "", "autostart": "true", "namespace": ""}


@pytest.fixture
def configuration(tmp_path: Path) -> Path:
    return write_configuration(tmp_path / "configuration", seed=7)


@pytest.fixture
def launch_file(load_launch_file: Callable[[str], dict[str, Any]]) -> dict[str, Any]:
    return load_launch_file("robot.launch.py")


def by_name(specs: list[NodeSpec]) -> dict[str, NodeSpec]:
    return {spec.name: spec for spec in specs}


class Context(dict[str, str]):
    """A launch's context, as far as it is asked."""

    is_shutdown = False


def context_of(configuration: Path, **changes: str) -> Context:
    return Context({"config": str(configuration), "journal": "out/journal"} | OPTIONAL | changes)


def test_the_launch_file_declares_its_arguments_and_only_two_must_be_given(launch_file: dict[str, Any]) -> None:
    *arguments, last = launch_file["generate_launch_description"]()
    given = {argument.arguments[0]: vars(argument).get("default_value") for argument in arguments}
    assert given == dict.fromkeys(REQUIRED) | OPTIONAL
    assert last.kind == "OpaqueFunction"


def test_a_robot_has_the_nodes_of_a_replay_without_the_player(tmp_path: Path, configuration: Path) -> None:
    bag = write_bag(tmp_path / "bag", input_entries(2))
    options = RunOptions(backends=2, record="out/belief", journal="out/journal")
    replay = by_name(node_set(bag, configuration, 1.0, options, has_tf2=True, has_stereo=True))
    robot = by_name(robot_set(configuration, options))
    assert set(robot) == set(replay) - {"bag_player"}
    for name, spec in robot.items():
        assert (spec.executable, spec.again) == (replay[name].executable, replay[name].again)
        assert not spec.followers
        assert not {"use_sim_time", "lossless", "source_bag"} & set(spec.parameters)


def test_what_the_robot_has_reaches_the_nodes_that_use_it(configuration: Path) -> None:
    detections = "vision_msgs/msg/Detection2DArray"
    sensors = Sensors(has_images=False, has_depth=False, has_imu=True, detections_type=detections)
    options = RunOptions(backends=3, journal="journal", record="out/b", autostart=False)
    specs = by_name(robot_set(configuration, options, sensors=sensors, map_prior="room.map"))
    manager, classifier = specs["hypothesis_manager"].parameters, specs["classifier"].parameters
    assert (manager["backends"], manager["map_prior"], manager["has_imu"]) == (3, "room.map", True)
    assert (classifier["has_images"], classifier["has_depth"]) == (False, False)
    assert classifier["detections_type"] == detections and specs["bag_recorder"].parameters["has_imu"] is True
    assert {name for name, spec in specs.items() if spec.parameters.get("seed") == 7} == {
        "classifier",
        "hypothesis_manager",
    }
    assert all(spec.parameters["autostart"] is False for spec in specs.values())
    assert "tf_odometry" not in specs
    plain = by_name(robot_set(configuration, RunOptions(journal="journal")))
    assert "detections_type" not in plain["classifier"].parameters and "bag_recorder" not in plain


def test_odometry_that_comes_by_tf_has_a_node_that_passes_it_on(tmp_path: Path) -> None:
    configuration = write_configuration(tmp_path, perception={"base_frame": "trunk"})
    options = RunOptions(journal="journal", autostart=False)
    specs = by_name(robot_set(configuration, options, sensors=Sensors(odom_frame="vio")))
    expected = {"odom_frame": "vio", "base_frame": "trunk", "autostart": False}
    assert (specs["tf_odometry"].executable, specs["tf_odometry"].parameters) == ("tf_odometry_node", expected)


def test_a_robot_needs_a_journal_and_a_backend(configuration: Path) -> None:
    with pytest.raises(InputError, match="journal is empty; name a folder"):
        robot_set(configuration, RunOptions())
    with pytest.raises(InputError, match="at least one backend"):
        robot_set(configuration, RunOptions(backends=0, journal="journal"))


def test_a_run_that_cannot_be_repeated_has_no_journal(tmp_path: Path) -> None:
    hurried = write_configuration(tmp_path, association="open", open_world={"time_budget_ms": 50.0})
    manager = by_name(robot_set(hurried, RunOptions(journal="journal")))["hypothesis_manager"]
    assert manager.parameters["journal"] == "" and manager.again is None


def test_a_recording_that_exists_is_refused_unless_it_may_be_replaced_or_goes_on(
    launch_file: dict[str, Any], configuration: Path, tmp_path: Path
) -> None:
    old = write_bag(tmp_path / "old", input_entries(1))
    with pytest.raises(InputError, match=r"old: exists already; give overwrite:=true to replace it"):
        launch_file["start_nodes"](context_of(configuration, record=str(old)))
    for permission in ("overwrite", "resume"):
        nodes = launch_file["start_nodes"](context_of(configuration, record=str(old), **{permission: "true"}))
        recorder = next(node for node in nodes if node.name == "bag_recorder")
        assert recorder.parameters[0][permission] is True


def test_all_nodes_of_a_launch_are_in_its_namespace_with_its_names_of_topics(
    launch_file: dict[str, Any], configuration: Path
) -> None:
    remap = "odom:=/my/odom image:=/camera/image"
    nodes = launch_file["start_nodes"](context_of(configuration, namespace="robot1", remap=remap))
    assert {node.namespace for node in nodes} == {"robot1"}
    assert all(node.remappings == [("odom", "/my/odom"), ("image", "/camera/image")] for node in nodes)
    for wrong in ("odom", ":=/my/odom", "odom:="):
        with pytest.raises(InputError, match="is not FROM:=TO; write for example"):
            launch_file["start_nodes"](context_of(configuration, remap=wrong))


def test_whichever_node_is_killed_is_started_again_and_none_takes_another_along(
    launch_file: dict[str, Any], configuration: Path
) -> None:
    context = context_of(configuration, record="out/belief")
    nodes, event = launch_file["start_nodes"](context), SimpleNamespace(returncode=-9)
    for node in nodes:
        text, timer = node.on_exit(event, context)
        (again,) = timer.actions
        assert text.kind == "LogInfo" and (again.name, again.executable) == (node.name, node.executable)
        assert again.remappings == node.remappings
        if node.name in ("hypothesis_manager", "bag_recorder"):
            assert again.parameters[0]["resume"] is True


def test_the_normal_end_of_no_node_ends_the_launch_but_bad_input_does(
    launch_file: dict[str, Any], configuration: Path
) -> None:
    context = context_of(configuration, record="out/belief")
    nodes = launch_file["start_nodes"](context)
    assert all(node.on_exit(SimpleNamespace(returncode=0), context)[0].kind == "LogInfo" for node in nodes)
    assert all(node.on_exit(SimpleNamespace(returncode=2), context)[0].kind == "Shutdown" for node in nodes)


def test_a_robot_of_several_has_a_map_frame_and_a_camera_on_a_joint(configuration: Path) -> None:
    options = RunOptions(journal="journal", map_frame="robot1/map")
    specs = by_name(robot_set(configuration, options, sensors=Sensors(has_moving_camera=True)))
    assert specs["hypothesis_manager"].parameters["map_frame"] == "robot1/map"
    assert specs["classifier"].parameters["has_moving_camera"] is True
    plain = by_name(robot_set(configuration, RunOptions(journal="journal")))
    assert "map_frame" not in plain["hypothesis_manager"].parameters
    assert "has_moving_camera" not in plain["classifier"].parameters
