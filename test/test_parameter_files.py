"""Parameter files of ROS 2: commands read in them what nodes read, and refuse what nodes refuse."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.ros.node.parameters import declare_configuration, refuse_undeclared
from semantic_slam.ros.node.ros_arguments import parsed

GROUPS = ("revision", "pruning", "open_world", "semantic_model", "odometry", "imu", "history")


@pytest.fixture(scope="module")
def ros() -> Iterator[None]:
    rclpy.init()
    yield
    rclpy.try_shutdown()


def by_a_command(path: Path) -> Configuration | str:
    """Configuration of a file, or why it is none."""
    try:
        return load_configuration(path)
    except InputError as fault:
        return str(fault)


def by_a_node(path: Path) -> Configuration | str:
    """Configuration with which a node starts that is given the file, or why it does not start."""
    words = ["--ros-args", "--params-file", str(path)]
    try:
        node = parsed(lambda: Node("reader", cli_args=words), words)
    except InputError as fault:
        return str(fault)
    try:
        configuration = declare_configuration(node)
        refuse_undeclared(node)
        return configuration
    except InputError as fault:
        return str(fault)
    finally:
        node.destroy_node()


def file_of(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "parameters.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    {text}\n")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "seed: 0x10",
        "seed: 010",
        "seed: 09",
        "seed: 3.0",
        "seed: &start 3",
        "'seed': 3",
        "{}",
        "pruning: {ratio: 1e3}",
        "pruning: {ratio: 0x1p3}",
        "pruning: {ratio: 1_000.0}",
        "pruning: {ratio: !!float 7}",
        "weights: {gate: .inf}",
        "weights: {gate: +.INF}",
        "odometry: {noise_factors: [1, 2]}",
        "odometry: {noise_factors: [1.0, 2e0]}",
        "perception: {extrinsics: []}",
        "open_world: {learn_region: y}",
        "open_world: {learn_region: off}",
        "perception: {base_frame: 2020-01-01}",
        "perception: {base_frame: null}",
        "perception: {base_frame: !!str y}",
        "semantic_model: {class_names: [cup, 2020-01-01, ~]}",
        "semantic_model: {class_names: ['1', 'y', \"2.0\"]}",
    ],
)
@pytest.mark.ros
def test_commands_read_the_values_that_nodes_read(ros: None, tmp_path: Path, text: str) -> None:
    path = file_of(tmp_path, text)
    read = by_a_command(path)
    assert isinstance(read, Configuration)
    assert by_a_node(path) == read


WHOLE = "write all with a point, as 1.0"
QUOTES = "write names in quotes"
VALUE = "lacks a value, which nodes refuse; give one, or remove it"


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        *((f"{group}: {{}}", f"nothing stands below '{group}', which nodes refuse; remove it") for group in GROUPS),
        *((f"{group}:", f"'{group}' {VALUE}") for group in GROUPS),
        *((f"{group}: ~", f"'{group}' must be a mapping; see config/default.yaml, or remove it") for group in GROUPS),
        ("", f"'ros__parameters' {VALUE}"),
        ("seed:", f"'seed' {VALUE}"),
        ("seed: ~", "'seed' has a wrong type ('~'); an example is 0"),
        ("seed: {}", "nothing stands below 'seed', which nodes refuse; remove it"),
        ("seed: 1_000", "'seed' has a wrong type ('1_000'); an example is 0"),
        ("seed: 1:30", "'seed' has a wrong type ('1:30'); an example is 0"),
        ("seed: 0b11", "'seed' has a wrong type ('0b11'); an example is 0"),
        ("seed: !!int '3'", "'seed' has a wrong type ('3'); an example is 0"),
        ("seed: {3: 1}\n    pruning: {max_poses: *a}", "YAML aliases (*name) are not read; write the values out"),
        ("pruning: {ratio: }", f"'pruning.ratio' {VALUE}"),
        ("odometry: {noise_factors: [0.5, 1]}", f"mixes whole numbers and decimals, which nodes refuse; {WHOLE}"),
        ("odometry: {noise_factors: [1.0, ~]}", QUOTES),
        ("odometry: {noise_factors: []}", "'odometry.noise_factors' is empty, which nodes refuse; give a value, or"),
        ("odometry: {noise_factors: 1.0}", "'odometry.noise_factors' has a wrong type (1.0); an example is (1.0,)"),
        ("odometry: {<<: {noise_factors: [1.0]}}", "unknown parameter 'odometry.<<'"),
        ("perception: {base_frame: y}", "'perception.base_frame' has a wrong type (True); an example is 'base_link'"),
        ("perception: {base_frame: nan}", "'perception.base_frame' has a wrong type (nan); an example is 'base_link'"),
        ("semantic_model: {class_names: cup}", "'semantic_model.class_names' has a wrong type ('cup'); an example is"),
        ("semantic_model: {class_names: []}", "'semantic_model.class_names' is empty, which nodes refuse"),
        ("semantic_model: {class_names: [y, n]}", "has a wrong type ([True, False]); an example is ('class_1'"),
        ("semantic_model: {class_names: [cup, n]}", QUOTES),
        ("semantic_model: {class_names: [cup, 1e3]}", QUOTES),
        ("semantic_model: {class_names: [cup, nan]}", QUOTES),
        ("open_world: {learn_region: !!bool 'true'}", "has a wrong type ('true'); an example is False"),
    ],
)  # fmt: skip
@pytest.mark.ros
def test_commands_refuse_what_nodes_refuse_with_the_remedy(ros: None, tmp_path: Path, text: str, remedy: str) -> None:
    path = file_of(tmp_path, text)
    refused, at_start = by_a_command(path), by_a_node(path)
    assert isinstance(refused, str) and isinstance(at_start, str)
    assert remedy in refused
    assert "\n" not in refused + at_start and ";" in at_start


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("seed:", "give a value there, or remove that line"),
        ("", "begin with '/**:' and 'ros__parameters:', as config/default.yaml does"),
        (
            "odometry: {noise_factors: [0.5, 1]}",
            "write all numbers of a list with a point, as 1.0, and names in quotes",
        ),
        ("seed: &a 3\n    other: *a", "write the values out"),
        ("revision: {}", "'revision' must be a mapping; see config/default.yaml, or remove it"),
        ("seed: {}", "'seed' is empty; give a value, or remove it"),
        ("odometry: {noise_factors: []}", "'odometry.noise_factors' is empty; give a value, or remove it"),
    ],
)
@pytest.mark.ros
def test_nodes_state_the_remedy_for_what_they_refuse(ros: None, tmp_path: Path, text: str, remedy: str) -> None:
    told = by_a_node(file_of(tmp_path, text))
    assert isinstance(told, str) and told.endswith(remedy)


@pytest.mark.ros
def test_what_is_meant_for_another_node_may_not_keep_ours_from_parsing_the_file(ros: None, tmp_path: Path) -> None:
    path = tmp_path / "parameters.yaml"
    for own, words in (("[1, 2.0]", WHOLE), ("", VALUE)):
        path.write_text(f"/**: {{ros__parameters: {{seed: 3}}}}\ncamera: {{ros__parameters: {{rates: {own}}}}}\n")
        refused = by_a_command(path)
        assert isinstance(refused, str) and "'rates'" in refused and words in refused
        assert isinstance(by_a_node(path), str)


def test_files_for_commands_alone_may_leave_values_out(tmp_path: Path) -> None:
    path = tmp_path / "plain.yaml"
    path.write_text("{revision: {}, odometry: {noise_factors: [0.5, 1]}}")
    assert load_configuration(path).odometry.noise_factors == (0.5, 1.0)
