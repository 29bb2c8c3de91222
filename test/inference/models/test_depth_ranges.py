"""Ranges that are depths along the sensor's axis: hypotheses take them for one or the other, and evidence decides."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from worlds.drives.open_room import Room, make_room

from semantic_slam.configuration import from_dict
from semantic_slam.errors import InputError
from semantic_slam.inference.building import make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.noise.noise_settings import NoiseSettings
from semantic_slam.inference.models.planar.depth_ranges import WIDEST_RAD
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.pool import InProcessPool

DEPTH = NoiseSettings(ranges_are_depth=True, axis_rad=0.1)
SINGLE = {"open_world": {"iterate_updates": False}}


def detection(range_m: float, bearing_rad: float) -> PlanarDetection:
    return PlanarDetection(
        range_m=range_m,
        bearing_rad=bearing_rad,
        covariance=np.array([[0.04, 0.002], [0.002, 0.01]]),
        sensor=np.zeros(2),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )


def with_depths(keyframe: Keyframe) -> Keyframe:
    """The keyframe as a camera would tell it that goes by apparent size."""
    measured = keyframe.measurements
    depths = measured.ranges_m * np.cos(measured.bearings_rad)
    return replace(keyframe, measurements=replace(measured, ranges_m=depths))


def named(room: Room) -> Room:
    """The room with detections that carry the number of their object."""
    told = zip(room.keyframes, room.associations, strict=True)
    return replace(room, keyframes=[_naming(keyframe, tuple(map(str, labels))) for keyframe, labels in told])


def _naming(keyframe: Keyframe, names: tuple[str, ...]) -> Keyframe:
    return replace(keyframe, measurements=replace(keyframe.measurements, track_ids=names))


def as_distances(keyframe: Keyframe) -> Keyframe:
    """The keyframe with distances and their covariances in place of depths."""
    own = keyframe.measurements
    told = zip(own.ranges_m, own.bearings_rad, own.geometric_covariances, strict=True)
    straight = NoiseSettings(ranges_are_depth=True)
    taken = [replace(detection(r, b), covariance=covariance).taken_as(straight) for r, b, covariance in told]
    covariances = np.array([each.covariance for each in taken]).reshape(-1, 2, 2)
    ranges = np.array([each.range_m for each in taken])
    return replace(keyframe, measurements=replace(own, ranges_m=ranges, geometric_covariances=covariances))


def run(room: Room) -> tuple[Engine, list[Any]]:
    engine = Engine.of_run(room.run, InProcessPool(1))
    return engine, [engine.process(keyframe) for keyframe in room.keyframes]


def test_a_depth_tells_the_distance_of_what_is_that_deep_along_the_axis() -> None:
    own = detection(2.0, 0.5).taken_as(DEPTH)
    assert own.range_m * np.cos(0.5 - 0.1) == pytest.approx(2.0)
    assert own.bearing_rad == 0.5


def test_the_covariance_of_a_depth_is_that_of_depth_and_bearing_to_first_order() -> None:
    step, told = 1e-6, detection(2.0, 0.5)
    by_depth = (detection(2.0 + step, 0.5).taken_as(DEPTH).range_m - told.taken_as(DEPTH).range_m) / step
    by_bearing = (detection(2.0, 0.5 + step).taken_as(DEPTH).range_m - told.taken_as(DEPTH).range_m) / step
    change = np.array([[by_depth, by_bearing], [0.0, 1.0]])
    np.testing.assert_allclose(told.taken_as(DEPTH).covariance, change @ told.covariance @ change.T, rtol=1e-5)


def test_the_density_stays_that_of_what_was_measured() -> None:
    told = detection(2.0, 0.5)
    own = told.taken_as(DEPTH)
    assert own.log_normaliser + told.log_change(DEPTH) == pytest.approx(told.log_normaliser)


@pytest.mark.parametrize("told", [detection(np.nan, 0.5), detection(2.0, 0.1 + WIDEST_RAD + 0.01)])
def test_a_bearing_alone_and_what_is_far_beside_the_axis_stay_as_they_are(told: PlanarDetection) -> None:
    own = told.taken_as(DEPTH)
    np.testing.assert_equal((own.range_m, own.covariance), (told.range_m, told.covariance))
    assert told.log_change(DEPTH) == 0.0


@pytest.mark.parametrize("is_depth", [False, True])
def test_evidence_decides_what_ranges_are(is_depth: bool) -> None:
    room = make_room(30, clutter=0.05, perception={"ranges_are": ["distance", "depth"]}, **SINGLE)
    if is_depth:
        room = replace(room, keyframes=[with_depths(keyframe) for keyframe in room.keyframes])
    _, beliefs = run(room)
    assert beliefs[0].noise_names == ("perception.ranges_are_depth",)
    assert beliefs[0].noise_values == pytest.approx([0.5], abs=0.1)
    assert beliefs[-1].noise_values == pytest.approx([float(is_depth)], abs=0.01)


def test_depths_weigh_as_much_as_the_distances_that_they_tell_but_for_the_change_of_units() -> None:
    """Told identities, so that no region counts: read as depths, against their distances with covariances of these."""
    given = {"association": "given", "detection_errors": {"correlated_share": 0.5}, **SINGLE}
    depths = named(make_room(12, clutter=0.0, perception={"ranges_are": ["depth"]}, **given))
    depths = replace(depths, keyframes=[with_depths(keyframe) for keyframe in depths.keyframes])
    told = [as_distances(keyframe) for keyframe in depths.keyframes]
    as_depths, _ = run(depths)
    as_told, _ = run(replace(make_room(12, clutter=0.0, **given), keyframes=told))
    bearings = np.concatenate([keyframe.measurements.bearings_rad for keyframe in told])
    change = float(-np.log(np.cos(bearings)).sum())
    assert change > 1.0
    assert as_depths.log_evidence == pytest.approx(as_told.log_evidence + change, abs=1e-9)


def test_a_region_of_depths_lies_between_two_lines_across_its_axis() -> None:
    """Its area, where it is, and where its points of equal area are, against points all about."""
    plain = SensorRegion(min_range_m=1.0, max_range_m=3.0, field_of_view_rad=2.0, direction_rad=0.3)
    region, random = plain.read_by(DEPTH), np.random.default_rng(0)
    points = random.uniform(-10.0, 10.0, size=(200_000, 2))
    depth = points @ [np.cos(0.1), np.sin(0.1)]
    bearing = np.arctan2(points[:, 1], points[:, 0])
    beyond = np.abs(bearing - 0.1) >= WIDEST_RAD
    reach = np.where(beyond, np.hypot(*points.T), depth)
    inside = (np.abs(bearing - 0.3) <= 1.0) & (reach >= 1.0) & (reach <= 3.0)
    np.testing.assert_array_equal(region.contains(points, np.zeros((len(points), 2, 2))) > 0.5, inside)
    assert region.area_m2 == pytest.approx(400.0 * inside.mean(), rel=0.02)
    assert np.hypot(*points[inside].T).max() <= region.farthest_m
    shares = [(bearing[inside] < edge).mean() for edge in region.even_bearings(4)]
    np.testing.assert_allclose(shares, [0.125, 0.375, 0.625, 0.875], atol=0.02)
    np.testing.assert_allclose(plain.even_bearings(4), 0.3 + np.array([-0.75, -0.25, 0.25, 0.75]))


@pytest.mark.parametrize(
    "settings",
    [
        {"association": "open", "perception": {"ranges_are": ["steps"]}, **SINGLE},
        {"association": "open", "perception": {"ranges_are": []}, **SINGLE},
        {"association": "open", "perception": {"ranges_are": ["depth"]}, "open_world": {"iterate_updates": True}},
    ],
)
def test_what_it_may_be_and_where_is_checked_at_the_start(settings: dict[str, Any]) -> None:
    values = from_dict({"semantic_model": {"kind": "none"}, **settings})
    with pytest.raises(InputError, match=r"perception\.ranges_are must be distance, depth or both"):
        make_run_configuration(values, None, np.array([0, 0, 0, 0, 0, 0, 1.0]), np.eye(6), stamp_ns=0)
