"""One definition of every parameter: dataclass, ROS parameters and YAML agree; wrong values are refused in one line."""

import dataclasses
import math
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
import yaml
from rclpy.parameter import Parameter

from semantic_slam import Engine
from semantic_slam.configuration import Configuration, from_dict, load_configuration, to_dict
from semantic_slam.errors import InputError
from semantic_slam.ros.node.parameters import (
    changed_parameters,
    declare_configuration,
    declare_fixed,
    leaves,
    refuse_undeclared,
)

CONFIG = Path(__file__).parents[1] / "config"
SHIPPED = sorted(path for path in CONFIG.glob("*.yaml") if not path.stem.endswith("_example"))


def flattened(values: dict, prefix: str = "") -> dict:
    flat = {}
    for name, value in values.items():
        flat |= flattened(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat


@pytest.fixture
def ros():
    rclpy.init()
    yield
    rclpy.try_shutdown()


def declared(**overrides):
    given = [Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()]
    node = rclpy.create_node("configured", parameter_overrides=given)
    try:
        configuration = declare_configuration(node)
        refuse_undeclared(node)
        return configuration, {name: node.describe_parameter(name) for name, _, _ in leaves()}
    finally:
        node.destroy_node()


def test_default_yaml_lists_every_parameter_with_its_default() -> None:
    text = (CONFIG / "default.yaml").read_text()
    listed = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert flattened(listed) == flattened(to_dict(Configuration()))
    undocumented = [line for line in text.splitlines() if ": " in line and "#" not in line]
    assert undocumented == []


def test_every_section_is_in_the_file_of_its_name() -> None:
    values = {item.name: getattr(Configuration(), item.name) for item in dataclasses.fields(Configuration)}
    sections = {name: type(value) for name, value in values.items() if dataclasses.is_dataclass(value)}
    files = {name: section.__module__.rpartition(".")[2] for name, section in sections.items()}
    assert files == {name: name for name in sections}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_configurations_are_valid_and_change_something(path: Path) -> None:
    changed = changed_parameters(load_configuration(path))
    assert bool(changed) == (path.stem != "default")


def test_da_bsp_differs_in_the_semantic_model_only() -> None:
    assert changed_parameters(load_configuration(CONFIG / "da_bsp.yaml")) == {"semantic_model.kind": "none"}


@pytest.mark.ros
def test_ros_parameters_default_to_the_dataclass(ros: None) -> None:
    configuration, descriptors = declared()
    assert configuration == Configuration()
    assert all(descriptor.description and descriptor.read_only for descriptor in descriptors.values())


@pytest.mark.ros
def test_ros_parameters_have_the_ranges_of_the_dataclass(ros: None) -> None:
    _, descriptors = declared()
    assert descriptors["pruning.ratio"].floating_point_range[0].from_value == 1.0
    assert descriptors["weights.num_samples"].integer_range[0].from_value == 1
    assert "laplace" in descriptors["weights.method"].additional_constraints


@pytest.mark.ros
def test_ros_parameters_reach_nested_fields(ros: None) -> None:
    configuration, _ = declared(pruning__ratio=10, perception__extrinsics=[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    assert configuration.pruning.ratio == 10.0  # an integer may stand for a number
    assert configuration.perception.extrinsics[2] == 1.0


@pytest.mark.ros
def test_changed_parameters_rebuild_the_configuration(ros: None) -> None:
    changed = from_dict({"seed": 3, "initial_pose": {"sigma": [1.0, 2.0, 0.5]}})
    overrides = {name.replace(".", "__"): value for name, value in changed_parameters(changed).items()}
    assert declared(**overrides)[0] == changed


@pytest.mark.parametrize("text", ["", "/**: {}", "/**:\n  ros__parameters: {}", "seed: 0"])
def test_empty_mappings_are_the_defaults(tmp_path: Path, text: str) -> None:
    path = tmp_path / "configuration.yaml"
    path.write_text(text)
    assert load_configuration(path) == Configuration()


def test_parameters_that_are_no_mapping_are_named(tmp_path: Path) -> None:
    path = tmp_path / "configuration.yaml"
    path.write_text("/**: [1]")
    with pytest.raises(InputError, match=r"'/\*\*' must be a mapping"):
        load_configuration(path)


@pytest.mark.parametrize("form", ["{}", "/**: {{ros__parameters: {}}}"])
def test_a_dotted_key_is_the_nested_one_as_in_ros_and_may_not_contradict_it(tmp_path: Path, form: str) -> None:
    def read(text: str) -> Configuration:
        path = tmp_path / "configuration.yaml"
        path.write_text(form.format(text))
        return load_configuration(path)

    nested = read("{pruning: {ratio: 7.0, max_hypotheses: 9}, moving: {share: 0.1}}")
    assert nested.pruning.ratio == 7.0
    assert read("{pruning.ratio: 7.0, pruning: {max_hypotheses: 9}, moving.share: 0.1}") == nested
    if form == "{}":  # nodes refuse a file with a group that is nothing
        assert read("{pruning.ratio: 7.0, pruning: , pruning.max_hypotheses: 9, moving.share: 0.1}") == nested
    for clash in ("pruning: {ratio: 7.0}", "pruning: 7.0"):
        with pytest.raises(InputError, match=r"'pruning\.ratio' is given again below 'pruning'"):
            read(f"{{pruning.ratio: 7.0, {clash}}}")
    with pytest.raises(InputError, match=r"unknown parameter 'pruning\.ration'"):
        read("{pruning.ration: 7.0}")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("hypothesis_manager: {ros__parameters: {seed: 1}}", "'hypothesis_manager'"),
        ("/robot1/classifier: {ros__parameters: {seed: 1}}", "'/robot1/classifier'"),
        ("robot1: {classifier: {ros__parameters: {seed: 1}}}", "'robot1'"),
        ("ros__parameters: {seed: 1}", "'ros__parameters'"),
    ],
)
def test_parameters_of_nodes_by_name_are_refused_with_the_name_that_all_read(
    tmp_path: Path, text: str, named: str
) -> None:
    path = tmp_path / "configuration.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"below {named}.*put the configuration's below '/\*\*:'"):
        load_configuration(path)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"perception": {"extrinsics": [0.0] * 6}}, "'perception.extrinsics' has 6 numbers; give 0 or 7"),
        ({"seed": 2**63}, "'seed' is 9223372036854775808; it must lie in"),
        ({"initial_pose": {"mean": []}}, "'initial_pose.mean' has 0 numbers; give 3 or 6"),
        ({"moving": {"share_by_label": [None]}}, "'moving.share_by_label' has a wrong type"),
        ({"odometry": {"noise_factors": [1.0, float("nan")]}}, "'odometry.noise_factors' has a wrong type"),
        ({"odometry": {"sigma_translation_per_m": 1e200}}, "give numbers of at most 1e+15"),
    ],
)
def test_impossible_values_are_refused(values: dict, text: str) -> None:
    with pytest.raises(InputError) as caught:
        from_dict(values)
    assert text in str(caught.value)


def values_refused(value: float) -> Iterator[tuple[str, str]]:
    """Each parameter, and what is said of ``value`` as its number or as each of its numbers; empty: it is taken."""
    for name, item, default in leaves():
        several = [value] * max(item.metadata.get("lengths", (1,)))
        group, _, own = name.rpartition(".")
        given = {own: several if isinstance(default, tuple) else value}
        try:
            from_dict({group: given} if group else given)
            yield name, ""
        except InputError as fault:
            yield name, str(fault)


INFINITE = {
    "weights.gate",
    "weights.importance_gate",
    "open_world.detection_half_ranges_m",
    "open_world.rates_ratio",
    "open_world.merge_position_m",
    "open_world.merge_heading_rad",
    "open_world.merge_object_m",
    "detection_errors.neighbour_m",
    "detection_errors.motion_m",
    "detection_errors.motion_rad",
    "keyframes.distance_m",
    "keyframes.angle_rad",
}
"""Parameters of which infinity is a sensible limit."""


def test_infinity_is_refused_in_one_line_but_where_a_parameter_says_what_it_means() -> None:
    refusals = dict(values_refused(math.inf))
    assert {name for name, text in refusals.items() if not text} == INFINITE
    for name, text in refusals.items():
        assert not text or (f"parameter '{name}'" in text and "\n" not in text)
    texts = {name: item.metadata["description"] for name, item, _ in leaves()}
    assert {name for name, text in texts.items() if ".inf" in text} == INFINITE
    assert all(text and "\n" not in text for _, text in values_refused(-math.inf))


def test_the_remedy_for_too_large_a_number_offers_infinity_only_where_it_is_taken() -> None:
    refusals = dict(values_refused(1e200))
    assert refusals["weights.gate"].endswith("give numbers of at most 1e+15, or .inf")
    assert refusals["odometry.sigma_slip_m"].endswith("give numbers of at most 1e+15")


@pytest.mark.parametrize(
    ("name", "twice"),
    [
        ("odometry.noise_factors", [4, 1.0, 4.0]),
        ("perception.noise_factors", [1.0, 1.0]),
        ("perception.ranges_are", ["depth", "depth"]),
        ("detection_errors.correlated_shares", [0.5, 0.5]),
        ("open_world.detection_probabilities", [0.8, 0.9, 0.9]),
        ("open_world.detection_half_ranges_m", [math.inf, math.inf]),
        ("open_world.miss_persistences", [0.5, 0.5]),
        ("open_world.clutters_per_frame", [0.1, 0.1]),
        ("open_world.birth_densities", [0.1, 0.1]),
        ("moving.speeds_m_s", [0.0, 1, 1.0]),
        ("semantic_model.class_names", ["cup", "cup"]),
        ("semantic_model.count_factors", [1.0, 1.0]),
        ("semantic_model.repeat_shares", [0.5, 0.5]),
        ("semantic_model.score_powers", [1.0, 1.0]),
        ("semantic_model.spread_shares", [0.1, 0.1]),
        ("semantic_model.noise_shares", [0.1, 0.1]),
    ],
)
def test_an_alternative_that_is_listed_twice_is_refused_as_it_would_count_twice(name: str, twice: list) -> None:
    group, _, own = name.partition(".")
    with pytest.raises(InputError) as caught:
        from_dict({group: {own: twice}})
    assert re.fullmatch(
        rf"configuration: parameter '{name}' has {twice[-1]!r} twice, .*; leave one out", caught.value.args[0]
    )
    assert getattr(getattr(from_dict({group: {own: twice[:-1]}}), group), own) == tuple(twice[:-1])


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"moving": {"share_by_label": ["person=0.1", "PERSON=0.5"]}}, "moving.share_by_label"),
        ({"open_world": {"departures_by_label": ["Person=1", "person=5"]}}, "open_world.departures_by_label"),
    ],
)
def test_a_label_that_has_two_numbers_is_refused_whatever_its_case(values: dict, name: str) -> None:
    world = {"iterate_updates": False, **values.pop("open_world", {})}
    settings = Configuration.of(association="open", semantic_model={"kind": "none"}, open_world=world, **values)
    with pytest.raises(InputError, match=f"^{name}: label 'person' is there twice, whatever the case; leave one out$"):
        Engine(settings)


def test_older_names_of_parameters_are_understood() -> None:
    older = from_dict({"open_world": {"settle": False}, "semantic_model": {"correlated_views": 2.0}})
    assert older == from_dict(
        {"open_world": {"iterate_updates": False}, "semantic_model": {"likelihood_tempering": 2.0}}
    )
    with pytest.raises(InputError, match=r"'open_world\.settle' and 'open_world\.iterate_updates' are one parameter"):
        from_dict({"open_world": {"settle": False, "iterate_updates": False}})


@pytest.mark.ros
def test_older_names_of_ros_parameters_are_understood(ros: None) -> None:
    configuration, _ = declared(open_world__settle=False)
    assert not configuration.open_world.iterate_updates


@pytest.mark.parametrize("name", ["pruning.ration", "associaton", "prunning.ratio"])
@pytest.mark.ros
def test_mistyped_parameter_is_refused(ros: None, name: str) -> None:
    with pytest.raises(InputError, match=f"unknown parameter '{re.escape(name)}'"):
        declared(**{name.replace(".", "__"): 10.0})


@pytest.mark.ros
def test_parameters_of_ros_itself_are_accepted(ros: None) -> None:
    configuration, _ = declared(use_sim_time=True, qos_overrides__odom__subscription__depth=3)
    assert configuration == Configuration()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "named"),
    [
        (
            ["backend_node", "--ros-args", "--params-file", "nosuch.yaml"],
            "nosuch.yaml: no such file of parameters; give a copy of config/default.yaml\n",
        ),
        (
            ["semantic_slam", "doctor", "--ros-args", "--params-file", "nosuch.yaml"],
            "nosuch.yaml: no such file of parameters; give a copy of config/default.yaml\n",
        ),
        (
            ["semantic_slam", "view", "--ros-args", "--params-file", "nosuch.yaml"],
            "nosuch.yaml: no such file of parameters; give a copy of config/default.yaml\n",
        ),
        (["semantic_slam", "doctor", "--ros-args", "-p", "3"], "token or wildcard; see config/default.yaml\n"),
        (["semantic_slam", "view", "--ros-args", "--params-file", __file__], "; see config/default.yaml\n"),
        (["backend_node", "--ros-args", "-p", "3"], "token or wildcard; see config/default.yaml\n"),
        (["backend_node", "--ros-args", "-p", "nosuch:=3"], "'nosuch'"),
        (["bag_player", "--ros-args", "-p", "rat:=1.0"], "'rat'"),
        (["bag_player"], "parameter bag is empty"),
        (["tf_odometry_node", "--ros-args", "-p", "lossless:=true"], "semantic_slam import bag --odom /tf"),
    ],
)
def test_wrong_ros_arguments_are_one_line(words: list[str], named: str) -> None:
    result = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert (result.returncode, result.stderr.count("\n")) == (2, 1), result.stderr
    assert named in result.stderr


@pytest.mark.slow
def test_one_file_of_the_configuration_may_address_every_node() -> None:
    words = ["bag_player", "--ros-args", "--params-file", str(CONFIG / "default.yaml")]
    result = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert "parameter bag is empty" in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parameter", "named"), [("pruning.ratio:=0.5", "pruning.ratio"), ("weights.method:=guess", "weights.method")]
)
def test_node_with_a_wrong_parameter_ends_with_code_2_and_one_line(parameter: str, named: str) -> None:
    words = ["hypothesis_manager_node", "--ros-args", "-p", parameter]
    result = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert named in result.stderr


@pytest.mark.parametrize(("given", "value"), [(2, 2.0), (0.5, 0.5)])
def test_a_parameter_of_a_node_is_read_once_and_a_whole_number_is_a_number(ros, given, value) -> None:
    node = rclpy.create_node("player", parameter_overrides=[Parameter("rate", value=given)])
    try:
        assert declare_fixed(node, "rate", 0.0) == value
        (answer,) = node.set_parameters([Parameter("rate", value=1.0)])
        assert not answer.successful and "read-only" in answer.reason
    finally:
        node.destroy_node()


def test_a_parameter_that_is_no_number_is_named(ros) -> None:
    node = rclpy.create_node("player", parameter_overrides=[Parameter("rate", value="fast")])
    try:
        with pytest.raises(InputError, match="parameters of player: rate is 'fast'; give a number"):
            declare_fixed(node, "rate", 0.0)
    finally:
        node.destroy_node()
