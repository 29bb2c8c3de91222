"""Somebody who sets what nobody reads is told, and what to set instead; the shipped configurations set none such."""

from pathlib import Path
from typing import Any

import pytest
from worlds.bags.bag_factory import write_bag
from worlds.bags.places import place_entries

from semantic_slam.configuration import Configuration, from_dict, load_configuration, to_dict
from semantic_slam.pipeline.idle_parameters import idle_parameters
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.shipped import configuration_file

SHIPPED = [
    "da_bsp",
    "default",
    "detector",
    "detector_second_session",
    "known_map",
    "open_world",
    "second_session",
    "spatial",
    "uncalibrated",
    "victoria_park",
]


def changed(name: str, section: str, **values: Any) -> Configuration:
    """A shipped configuration with other values in one section."""
    whole = to_dict(load_configuration(configuration_file(name)))
    return from_dict({**whole, section: {**whole[section], **values}})


@pytest.mark.parametrize(
    ("values", "remedy"),
    [
        ({"clutter_per_frame": 5.0}, "set the values of open_world.clutters_per_frame, or [] for this one alone"),
        ({"birth_density": 0.001}, "set the values of open_world.birth_densities, or [] for this one alone"),
        ({"field_of_view_rad": 0.3}, "set learn_region: false to state it"),
    ],
)
def test_a_rate_or_region_that_another_parameter_replaces_is_named(values: dict[str, float], remedy: str) -> None:
    (found,) = idle_parameters(changed("detector", "open_world", **values))
    (name,) = values
    assert found.what.startswith(f"open_world.{name} has no effect") and found.remedy == remedy


def test_the_direction_along_which_ranges_may_be_depths_is_not_idle() -> None:
    assert not list(idle_parameters(changed("uncalibrated", "open_world", direction_rad=0.7)))
    (found,) = idle_parameters(changed("detector", "open_world", direction_rad=0.7))
    assert "direction_rad" in found.what


def test_a_bound_of_a_region_that_is_not_learned_is_named() -> None:
    (found,) = idle_parameters(changed("detector", "open_world", learn_region=False))
    assert "learn_region_within_m" in found.what and found.remedy == "set max_range_m"


def test_rates_are_not_told_to_be_set_where_no_rates_are_read() -> None:
    whole = to_dict(changed("detector", "open_world", clutter_per_frame=5.0))
    assert not list(idle_parameters(from_dict({**whole, "association": "given"})))


def test_a_tempering_that_the_kind_does_not_read_is_named() -> None:
    (found,) = idle_parameters(changed("detector", "semantic_model", likelihood_tempering=50.0))
    assert "kind: detector" in found.what and "repeat_shares" in found.remedy


def test_rates_that_are_read_are_not_named() -> None:
    assert not list(idle_parameters(changed("open_world", "open_world", clutter_per_frame=5.0, field_of_view_rad=0.3)))
    assert not list(idle_parameters(changed("default", "semantic_model", likelihood_tempering=50.0)))


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_configurations_set_nothing_idle(name: str) -> None:
    assert not list(idle_parameters(load_configuration(configuration_file(name))))


def test_a_run_says_so_before_it_begins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "bag", place_entries("ranges", 3))
    settings = changed("uncalibrated", "open_world", birth_density=0.001)
    run_bag(bag, tmp_path / "beliefs", settings)
    assert f"{bag}: open_world.birth_density has no effect" in capsys.readouterr().out
