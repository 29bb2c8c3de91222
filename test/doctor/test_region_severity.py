"""The doctor calls it an error if a tenth of the detections lie where a run in the plane expects none."""

from pathlib import Path

import pytest
from worlds.bags.bag_factory import write_bag
from worlds.bags.places import named_entries

from semantic_slam.configuration import Configuration
from semantic_slam.doctor.bag_summary import summarise_bag
from semantic_slam.doctor.examination import examine
from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.inference.world.map_prior import MapPrior

FAR_M, NUM_FRAMES = 9.0, 5


def of_region(folder: Path, num_near: int, **world: object) -> list[Finding]:
    """What is found of things ahead, of which all but one are near."""
    things = {f"thing {n}": (2.0 + 0.2 * n, 0.1 * n - 0.5) for n in range(num_near)} | {"tower": (FAR_M, 0.0)}
    bag = write_bag(folder / "bag", named_entries(things, NUM_FRAMES))
    settings = Configuration.of(association="open", semantic_model={"kind": "none"}, open_world=world)
    summary, faults = summarise_bag(bag, settings, MapPrior())
    return [own for own in [*faults, *examine(summary)] if own.check == "region"]


def test_one_in_ten_is_an_error(tmp_path: Path) -> None:
    (found,) = of_region(tmp_path, 9)
    assert found.severity is Severity.ERROR
    assert found.what.startswith(f"{NUM_FRAMES} of the first {10 * NUM_FRAMES} detections lie outside")
    assert found.remedy.endswith("or learn_region: true with learn_region_within_m")


@pytest.mark.parametrize("world", [{"max_range_m": FAR_M + 0.1}, {"learn_region": True}])
def test_either_remedy_helps(tmp_path: Path, world: dict[str, object]) -> None:
    assert of_region(tmp_path, 9, **world) == []


def test_what_lies_beyond_the_range_up_to_which_it_is_learned_is_an_error(tmp_path: Path) -> None:
    learned = {"learn_region": True, "learn_region_within_m": 5.0}
    (found,) = of_region(tmp_path / "near", 9, **learned)
    assert found.severity is Severity.ERROR
    assert found.remedy.startswith("set open_world.learn_region_within_m near 9 ")
    assert of_region(tmp_path / "far", 9, **{**learned, "learn_region_within_m": FAR_M + 0.1}) == []


def test_one_in_eleven_is_none(tmp_path: Path) -> None:
    assert of_region(tmp_path, 10) == []
