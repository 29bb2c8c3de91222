"""YAML of users: what a loader would drop in silence is refused, by every reader of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from semantic_slam.configuration import PerceptionConfiguration, load_configuration
from semantic_slam.datasets.user_bag.label_map import read_label_map
from semantic_slam.errors import InputError
from semantic_slam.perception.networks.imagenet import reported_classes
from semantic_slam.text_files import parse_yaml


def groups(path: Path) -> Any:
    return reported_classes(PerceptionConfiguration(class_groups=str(path)))


@pytest.mark.parametrize(
    ("read", "text", "key", "lines"),
    [
        (groups, "cup: [cup]\nchair: [rocking chair]\ncup: [coffee mug]\n", "cup", (1, 3)),
        (read_label_map, "cup: mug\n'cup': glass\n", "cup", (1, 2)),
        (load_configuration, "perception:\n  labels: [a]\n  num_passes: 3\n  labels: [b]\n", "labels", (2, 4)),
        (load_configuration, "open_world: {max_range_m: 5.0, max_range_m: 6.0}\n", "max_range_m", (1, 1)),
    ],
)
def test_a_key_that_a_mapping_has_twice_is_refused(
    read: Callable[[Path], Any], text: str, key: str, lines: tuple[int, int], tmp_path: Path
) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"own.yaml: .*'{key}' in line {lines[0]} and again in line {lines[1]}"):
        read(path)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a: {x: 1}\nb: {x: 2}\n1: c\n'1': d\n", {"a": {"x": 1}, "b": {"x": 2}, 1: "c", "1": "d"}),
        ("- {x: 1}\n- {x: 1}\n", [{"x": 1}, {"x": 1}]),
        ("# nothing\n", None),
    ],
)
def test_a_key_of_several_mappings_and_a_number_beside_its_text_are_well(text: str, values: Any) -> None:
    assert parse_yaml(text, "own.yaml", "") == values
