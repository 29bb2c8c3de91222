"""The doctor compares detections in space with the camera's own region, wherever the camera looks."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from semantic_slam_lab.simulation.tables import T_BODY_CAMERA, Flight, table_tops
from worlds.bags.bag_factory import Entry, input_entries, of_topic, without, write_bag
from worlds.bags.mistakes import each, rotated
from worlds.bags.table_bag import in_space, table_entries, write_table_bag

from semantic_slam.configuration import Configuration, from_dict, load_configuration, to_dict
from semantic_slam.doctor.bag_summary import summarise_bag
from semantic_slam.doctor.examination import examine
from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.building.spatial_checks import check_space
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.shipped import CONFIGURATIONS

DOWN = np.append(np.zeros(3), so3.exp(np.array([0.0, np.radians(60.0), 0.0])))
"""Pose in the body of what looks along the body's x, turned down by 60 degrees."""
T_DOWN_CAMERA = se3.compose(DOWN, T_BODY_CAMERA)
SPACE = load_configuration(CONFIGURATIONS / "spatial.yaml")


def flown_looking_down() -> list[Entry]:
    """Positions of a camera that looks 60 degrees down."""
    room = table_tops(Flight(keyframes=12, things=8), SpatialRegion.of(in_space().open_world), np.random.default_rng(5))
    entries = table_entries(room)
    for entry in of_topic(entries, topics.DETECTIONS):
        told = from_message(entry.message)
        spread = so3.matrix(DOWN[3:]) @ told.position_covariances @ so3.matrix(DOWN[3:]).T
        positions = so3.rotated(DOWN[3:], told.positions)
        entry.message = to_message(replace(told, positions=positions, position_covariances=spread))
    return entries


def in_down_space(*, extrinsics: list[float] | None = None, **region: float) -> Configuration:
    values = to_dict(in_space())
    values["perception"]["extrinsics"] = T_DOWN_CAMERA.tolist() if extrinsics is None else extrinsics
    values["open_world"] |= region
    return from_dict(values, "test")


def of_region(bag: Path, configuration: Configuration, prior: MapPrior | None = None) -> list[Finding]:
    summary, faults = summarise_bag(bag, configuration, prior)
    return [*faults, *(found for found in examine(summary) if found.check == "region")]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_table_bag(tmp_path_factory.mktemp("down") / "bag", flown_looking_down())


def test_a_camera_that_looks_down_and_says_so_is_healthy(bag: Path) -> None:
    assert of_region(bag, in_down_space()) == []


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("field_of_view_rad", 0.2),
        ("vertical_field_of_view_rad", 0.1),
        ("max_range_m", 1.2),
        ("min_range_m", 2.0),
    ],
)
def test_the_remedy_names_what_is_too_small_and_space_accepts_it(bag: Path, name: str, value: float) -> None:
    (found,) = of_region(bag, in_down_space(**{name: value}))
    assert "learn_region" not in found.line and found.remedy.startswith(f"set of open_world {name} near ")
    wanted = float(found.remedy.split(" near ")[1].split(",")[0])
    mended = in_down_space(**{name: wanted})
    check_space(mended, strategy_of(mended))
    assert of_region(bag, mended) == []


def test_a_camera_that_looks_behind_its_detections_is_to_be_stated(bag: Path) -> None:
    back = np.append(np.zeros(3), so3.exp(np.array([0.0, 0.0, np.pi])))
    (found,) = of_region(bag, in_down_space(extrinsics=se3.compose(back, T_BODY_CAMERA).tolist()))
    assert found.severity is Severity.ERROR and "perception.extrinsics" in found.remedy
    assert "field_of_view" not in found.remedy


@pytest.mark.parametrize("has_pictures", [True, False])
@pytest.mark.parametrize("has_depth", [True, False])
def test_boxes_are_where_the_camera_is_mounted(tmp_path: Path, has_pictures: bool, has_depth: bool) -> None:
    """A mount on /tf_static, turned down, changes nothing of where boxes are in the image."""
    quaternion = so3.product(DOWN[3:], T_BODY_CAMERA[3:])
    entries = each(topics.TF_STATIC, rotated(*quaternion))(input_entries(8, with_depth=has_depth))
    if not has_pictures:
        for topic in (topics.IMAGE_COMPRESSED, topics.DEPTH_COMPRESSED):
            entries = without(entries, topic)
    written, narrow = write_bag(tmp_path / "bag", entries), _with_region(field_of_view_rad=0.15)
    assert of_region(written, SPACE, MapPrior()) == []
    (found,) = of_region(written, narrow, MapPrior())
    assert "field_of_view_rad near 0.4" in found.remedy and "vertical" not in found.remedy


def _with_region(**region: Any) -> Configuration:
    return replace(SPACE, open_world=replace(SPACE.open_world, **region))


@pytest.mark.parametrize("has_pictures", [True, False])
def test_where_the_image_is_the_region_no_box_lies_outside_whatever_is_typed(
    tmp_path: Path, has_pictures: bool
) -> None:
    entries = input_entries(8)
    if not has_pictures:
        for topic in (topics.IMAGE_COMPRESSED, topics.DEPTH_COMPRESSED):
            entries = without(entries, topic)
    written = write_bag(tmp_path / "bag", entries)
    typed, image = (_with_region(field_of_view_rad=0.15, region_by_camera=own) for own in (False, True))
    assert of_region(written, image, MapPrior()) == []
    assert len(of_region(written, typed, MapPrior())) == 1


def test_a_camera_says_nothing_of_how_far_it_sees(tmp_path: Path) -> None:
    """The remedy names the range, and no angle."""
    written = write_bag(tmp_path / "bag", input_entries(8))
    near = _with_region(field_of_view_rad=0.15, max_range_m=0.5, region_by_camera=True)
    (found,) = of_region(written, near, MapPrior())
    assert "max_range_m near" in found.remedy and "field_of_view_rad" not in found.remedy
