"""The demo's launch file, as far as it can be checked where ``launch`` is not installed, and the node set behind it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from worlds.bags.bag_factory import T_BASE_CAMERA, input_entries, write_bag, write_configuration
from worlds.bags.stereo import by_stereo

from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.pipeline.detector_labels import labels_in
from semantic_slam.ros.launching.node_set import NodeSpec, RunOptions, node_set

ROOT = Path(__file__).parents[3]
ARGUMENTS = {"bag", "config", "backends", "rate", "record", "overwrite", "journal", "resume", "autostart", "namespace"}


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write_bag(tmp_path / "bag", input_entries(2))


@pytest.fixture
def configuration(tmp_path: Path) -> Path:
    return write_configuration(tmp_path / "configuration", seed=7)


def specs_of(
    bag: Path,
    configuration: Path,
    *,
    rate: float = 0.0,
    has_tf2: bool = False,
    has_stereo: bool = True,
    **changes: Any,
) -> dict[str, NodeSpec]:
    options = replace(RunOptions(backends=2, record="out/belief"), **changes)
    specs = node_set(bag, configuration, rate, options, has_tf2=has_tf2, has_stereo=has_stereo)
    return {spec.name: spec for spec in specs}


def test_node_set_has_the_names_of_the_interface(bag: Path, configuration: Path) -> None:
    specs = specs_of(bag, configuration)
    assert set(specs) == {"bag_player", "classifier", "hypothesis_manager", "backend_0", "backend_1", "bag_recorder"}
    assert specs["hypothesis_manager"].parameters["backends"] == 2
    assert [specs[f"backend_{n}"].parameters["backend_id"] for n in range(2)] == [0, 1]
    assert specs["hypothesis_manager"].parameters["map_prior"] == str(bag / "objects.json")


def test_every_executable_is_installed_by_setup_py(bag: Path, configuration: Path) -> None:
    setup = (ROOT / "setup.py").read_text()
    assert all(f'"{spec.executable}"' in setup for spec in specs_of(bag, configuration).values())


def test_configuration_reaches_the_nodes_that_use_it(bag: Path, configuration: Path) -> None:
    specs = specs_of(bag, configuration)
    assert {name for name, spec in specs.items() if spec.parameters.get("seed") == 7} == {
        "classifier",
        "hypothesis_manager",
    }


def test_the_manager_knows_all_labels_of_the_bag_where_they_mean_something(bag: Path, tmp_path: Path) -> None:
    plain = write_configuration(tmp_path / "plain")
    assert "semantic_model.labels" not in specs_of(bag, plain)["hypothesis_manager"].parameters
    with BagReader(bag) as reader:
        told = labels_in(reader, absolute(topics.DETECTIONS))
    assert told
    words = write_configuration(tmp_path / "words", association="open", semantic_model={"kind": "detector"})
    named = specs_of(bag, words)["hypothesis_manager"].parameters["semantic_model.labels"]
    assert named == sorted(named)
    assert told <= set(named)
    few = {"kind": "detector", "labels": ["chair"]}
    listed = write_configuration(tmp_path / "listed", association="open", semantic_model=few)
    assert specs_of(bag, listed)["hypothesis_manager"].parameters["semantic_model.labels"] == ["chair"]  # as told


def test_without_autostart_every_node_waits_and_with_it_none_is_told_so(bag: Path, configuration: Path) -> None:
    waiting = specs_of(bag, configuration, autostart=False).values()
    assert all(spec.parameters["autostart"] is False for spec in waiting)
    assert not any("autostart" in spec.parameters for spec in specs_of(bag, configuration).values())


def test_rate_zero_is_lossless_everywhere(bag: Path, configuration: Path) -> None:
    for rate, lossless in ((0.0, True), (1.0, False)):
        specs = specs_of(bag, configuration, rate=rate)
        player = specs.pop("bag_player")
        assert player.parameters["rate"] == rate
        assert {spec.parameters["lossless"] for spec in specs.values()} == {lossless}


def test_without_tf2_the_classifier_is_given_the_extrinsics(bag: Path, configuration: Path) -> None:
    given = specs_of(bag, configuration)["classifier"].parameters["perception.extrinsics"]
    assert given == pytest.approx(T_BASE_CAMERA.tolist())
    assert "perception.extrinsics" not in specs_of(bag, configuration, has_tf2=True)["classifier"].parameters


def test_bag_without_depth_is_bearing_only(tmp_path: Path, configuration: Path) -> None:
    bag = write_bag(tmp_path / "flat", input_entries(2, with_depth=False))
    assert specs_of(bag, configuration)["classifier"].parameters["has_depth"] is False


def test_disparities_are_depth_only_where_they_can_be_published(tmp_path: Path, configuration: Path) -> None:
    """Where stereo_msgs is not installed, the classifier waits for depth only if the bag has other depth."""
    stereo = by_stereo(input_entries(2))
    for name, entries, without in (("stereo", stereo, False), ("both", [*stereo, *input_entries(2)], True)):
        bag = write_bag(tmp_path / name, entries)
        for has_stereo, wanted in ((True, True), (False, without)):
            classifier = specs_of(bag, configuration, has_stereo=has_stereo)["classifier"]
            assert classifier.parameters["has_depth"] is wanted


def test_no_backend_is_refused(bag: Path, configuration: Path) -> None:
    with pytest.raises(InputError, match="at least one backend"):
        specs_of(bag, configuration, backends=0)


@pytest.fixture
def launch_file(load_launch_file: Callable[[str], dict[str, Any]]) -> dict[str, Any]:
    return load_launch_file("demo.launch.py")


def test_launch_file_declares_the_arguments_of_the_interface(launch_file: dict[str, Any]) -> None:
    description = launch_file["generate_launch_description"]()
    declared = {action.arguments[0] for action in description if action.kind == "DeclareLaunchArgument"}
    assert declared == ARGUMENTS
    assert description[-1].kind == "OpaqueFunction"


def context_of(bag: Path, configuration: Path, **changes: str) -> dict[str, str]:
    values = {"backends": "1", "rate": "0.0", "record": "out/belief", "overwrite": "false"}
    values |= {"journal": "", "resume": "false", "autostart": "true", "namespace": ""}
    return {"bag": str(bag), "config": str(configuration), **values, **changes}


@pytest.mark.parametrize("overwrite", ["false", "true"])
def test_the_launch_never_records_over_the_bag_that_it_plays(
    launch_file: dict[str, Any], bag: Path, configuration: Path, overwrite: str
) -> None:
    with pytest.raises(InputError, match="is an input of this command; name another output"):
        launch_file["start_nodes"](context_of(bag, configuration, record=str(bag), overwrite=overwrite))


def test_the_launch_replaces_an_old_recording_only_when_told_to(
    launch_file: dict[str, Any], bag: Path, configuration: Path, tmp_path: Path
) -> None:
    old = write_bag(tmp_path / "old", input_entries(1))
    with pytest.raises(InputError, match=r"old: exists already; give overwrite:=true to replace it"):
        launch_file["start_nodes"](context_of(bag, configuration, record=str(old)))
    nodes = launch_file["start_nodes"](context_of(bag, configuration, record=str(old), overwrite="true"))
    recorder = next(node for node in nodes if node.name == "bag_recorder")
    assert recorder.parameters[0]["overwrite"] is True


def test_the_launch_never_replaces_a_recording_of_another_software(
    launch_file: dict[str, Any], bag: Path, configuration: Path, tmp_path: Path
) -> None:
    mine = write_bag(tmp_path / "mine", input_entries(1))
    metadata = mine / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("written_by: semantic_slam", "robot: mine"))
    with pytest.raises(InputError, match="it is not replaced"):
        launch_file["start_nodes"](context_of(bag, configuration, record=str(mine), overwrite="true"))


def test_launch_file_starts_the_node_set(launch_file: dict[str, Any], bag: Path, configuration: Path) -> None:
    context = context_of(bag, configuration, backends="3")
    nodes = launch_file["start_nodes"](context)
    expected = specs_of(bag, configuration, backends=3, journal="out/belief.journal")
    assert {node.name: (node.executable, node.parameters) for node in nodes} == {
        spec.name: (spec.executable, [spec.parameters]) for spec in expected.values()
    }


def test_all_nodes_of_a_launch_are_in_its_namespace(
    launch_file: dict[str, Any], bag: Path, configuration: Path
) -> None:
    nodes = launch_file["start_nodes"](context_of(bag, configuration, namespace="robot1"))
    assert {node.namespace for node in nodes} == {"robot1"}


class Context(dict[str, str]):
    """A launch's context, as far as it is asked."""

    is_shutdown = False


@pytest.fixture
def launched(launch_file: dict[str, Any], bag: Path, configuration: Path) -> tuple[dict[str, Any], Context]:
    """The nodes that were started, by name, and the launch's context."""
    context = Context(context_of(bag, configuration))
    return {node.name: node for node in launch_file["start_nodes"](context)}, context


@pytest.mark.parametrize(("exit_code", "expected"), [(0, {"bag_recorder"}), (2, None)])
def test_end_of_the_recorder_and_bad_input_end_the_launch(
    launched: tuple[dict[str, Any], Context], exit_code: int, expected: set[str] | None
) -> None:
    nodes, context = launched
    event = SimpleNamespace(returncode=exit_code)
    actions = {name: node.on_exit(event, context) for name, node in nodes.items()}
    ending = {name for name, told in actions.items() if [action.kind for action in told] == ["Shutdown"]}
    assert ending == (set(nodes) if expected is None else expected)


def test_a_node_that_was_killed_is_started_again_by_the_launch(launched: tuple[dict[str, Any], Context]) -> None:
    nodes, context = launched
    event = SimpleNamespace(returncode=-9)
    text, timer = nodes["hypothesis_manager"].on_exit(event, context)
    assert text.kind == "LogInfo" and timer.kind == "TimerAction" and timer.period > 0.0
    (again,) = timer.actions
    assert (again.name, again.executable) == ("hypothesis_manager", "hypothesis_manager_node")
    assert again.parameters[0]["resume"] and again.parameters[0]["journal"] == "out/belief.journal"
    assert again.on_exit(event, context)[1].actions[0].name == "hypothesis_manager"
    context.is_shutdown = True
    assert again.on_exit(event, context) == []


def test_the_player_is_killed_and_started_with_a_classifier_that_died(
    launched: tuple[dict[str, Any], Context],
) -> None:
    nodes, context = launched
    event = SimpleNamespace(returncode=-9)
    _, kill, _ = nodes["classifier"].on_exit(event, context)
    assert kill.event.kind == "SignalProcess" and kill.event.process_matcher is nodes["bag_player"]
    (timer,) = nodes["bag_player"].on_exit(event, context)
    assert timer.actions[0].name == "bag_player"


def test_a_player_that_waits_to_be_started_is_not_killed_and_its_next_end_is_its_own(
    launched: tuple[dict[str, Any], Context],
) -> None:
    nodes, context = launched
    died, ended = SimpleNamespace(returncode=1), SimpleNamespace(returncode=0)
    player = nodes["bag_player"].on_exit(died, context)[-1].actions[0]
    player.process_details = None
    assert [action.kind for action in nodes["classifier"].on_exit(died, context)] == ["LogInfo", "TimerAction"]
    assert [action.kind for action in player.on_exit(ended, context)] == ["LogInfo"]


def test_without_a_journal_the_manager_is_not_started_again(bag: Path, configuration: Path) -> None:
    assert specs_of(bag, configuration)["hypothesis_manager"].again is None
    assert specs_of(bag, configuration, journal="out/journal")["hypothesis_manager"].again == {"resume": True}
