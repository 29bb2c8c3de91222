"""A real drive is healthy under a configuration for it; under one for rooms the doctor says what it lacks."""

from collections.abc import Callable
from pathlib import Path

import pytest
from worlds.bags.imported import import_bag

from semantic_slam.configuration import load_configuration
from semantic_slam.doctor.bag_summary import summarise_bag
from semantic_slam.doctor.examination import examine
from semantic_slam.shipped import configuration_file


@pytest.mark.long
@pytest.mark.real_data
@pytest.mark.slow
def test_parked_cars_are_too_far_away_for_rooms_alone(
    data_set: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = tmp_path / "bag"
    import_bag(monkeypatch, "kitti_tracking", data_set("kitti_tracking"), "--drive", "0001", "--out", bag)
    for name, checks in (("uncalibrated", []), ("detector", ["region"])):
        summary, faults = summarise_bag(bag, load_configuration(configuration_file(name)), None)
        found = [*faults, *examine(summary)]
        assert [finding.check for finding in found] == checks
    assert "learn_region_within_m near 71" in found[0].remedy
