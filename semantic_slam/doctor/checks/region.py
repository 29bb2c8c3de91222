"""Check of the sensor region, in the plane and in space: detections outside the configured one."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.inputs.spatial_reader import camera_of, points_of
from semantic_slam.inference.open_world.planar.region import is_left_out, sensor_region
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.points_input import are_outside, seen_from_camera
from semantic_slam.pipeline.assembly.region_watch import MANY

NAME = "region"
REACH = 0.99
"""Share of them that the remedy's numbers hold."""
MUCH_NARROWER = 0.8
"""Share of the field of view about the configured direction below which another direction is recommended."""
WIDEST_RAD = 3.0
"""Largest full angle recommended in space, where an image spans less than half a turn."""


def check(summary: InputSummary) -> Iterator[Finding]:
    configuration, world = summary.configuration, summary.configuration.open_world
    if not strategy_of(configuration).counts_misses or summary.evidence.turn:
        return
    told = [each.measurements for each in summary.keyframes if len(each.measurements)]
    if told and world.learn_region:
        yield from _learned(told, world)
    elif told:
        yield from (_in_space if configuration.is_spatial else _in_plane)(told, world)


def _learned(told: list[SemanticMeasurements], world: OpenWorldConfiguration) -> Iterator[Finding]:
    """Detections beyond the range up to which a region is learned."""
    ranges_m = np.concatenate([each.ranges_m for each in told])
    beyond = is_left_out(ranges_m, np.zeros(len(ranges_m)), world)
    reach_m = float(np.quantile(ranges_m[beyond], REACH)) if beyond.any() else 0.0
    yield from _finding(
        beyond,
        f"learned up to {world.learn_region_within_m:g} m",
        f"reach to {reach_m:.3g} m",
        f"set open_world.learn_region_within_m near {_two_digits(reach_m, math.ceil):g} if they are of things, and not"
        " of a far wall",
    )


def _in_plane(told: list[SemanticMeasurements], world: OpenWorldConfiguration) -> Iterator[Finding]:
    ranges_m = np.concatenate([each.ranges_m for each in told])
    bearings_rad = np.concatenate([each.bearings_rad for each in told])
    known_m = ranges_m[np.isfinite(ranges_m)]
    seen = _sector_of(bearings_rad)
    reach = f"from {np.degrees(seen.right_rad):.0f} to {np.degrees(seen.left_rad):.0f} deg"
    if len(known_m):
        reach += f" and to {np.quantile(known_m, REACH):.3g} m"
    looks = f" about {np.degrees(world.direction_rad):.0f} deg" if world.direction_rad else ""
    yield from _finding(
        ~sensor_region(world).holds(ranges_m, bearings_rad),
        f"{world.min_range_m:g} to {world.max_range_m:g} m, {np.degrees(world.field_of_view_rad):.0f} deg{looks}",
        f"reach {reach}",
        _remedy_in_plane(world, bearings_rad, seen, known_m),
    )


class _Sector(NamedTuple):
    """Bearings in the body frame, counter-clockwise from the right to the left one."""

    right_rad: float
    left_rad: float

    @property
    def middle_rad(self) -> float:
        return float(wrap_angle(np.array(0.5 * (self.right_rad + self.left_rad))))

    @property
    def width_rad(self) -> float:
        return self.left_rad - self.right_rad


def _sector_of(bearings_rad: Array) -> _Sector:
    """The sector of (N,) bearings but for a few on either side, which lie around their circular mean."""
    mean_rad = float(np.angle(np.exp(1j * bearings_rad).mean()))
    right_rad, left_rad = np.quantile(wrap_angle(bearings_rad - mean_rad), [0.5 - 0.5 * REACH, 0.5 + 0.5 * REACH])
    return _Sector(mean_rad + float(right_rad), mean_rad + float(left_rad))


def _remedy_in_plane(world: OpenWorldConfiguration, bearings_rad: Array, seen: _Sector, known_m: Array) -> str:
    """What of the region to enlarge, or where to turn it where that is much narrower."""
    wanted = []
    around_rad = float(2.0 * np.quantile(np.abs(wrap_angle(bearings_rad - world.direction_rad)), REACH))
    if around_rad > world.field_of_view_rad:
        if seen.width_rad < MUCH_NARROWER * around_rad:
            wanted.append(f"direction_rad near {seen.middle_rad:.2f}")
            around_rad = seen.width_rad
        wanted.append(f"field_of_view_rad near {min(around_rad, 2.0 * np.pi):.2f}")
    wanted += _ranges_to_set(known_m, world.min_range_m, world.max_range_m)
    named = " and ".join(filter(None, [", ".join(wanted[:-1]), *wanted[-1:]]))
    learned = "" if world.detection_by_direction else ", or learn_region: true with learn_region_within_m"
    return f"set open_world.{named}, as far as the sensor sees{learned}"


def _ranges_to_set(known_m: Array, min_range_m: float, max_range_m: float) -> list[str]:
    """Range limits of the region that hold (N,) distances but for a few, where they do not."""
    if not len(known_m):
        return []
    nearest_m = np.quantile(known_m, 1.0 - REACH, method="lower")
    farthest_m = np.quantile(known_m, REACH, method="higher")
    nearer = [f"min_range_m near {_two_digits(nearest_m, math.floor):g}"] if nearest_m < min_range_m else []
    return nearer + ([f"max_range_m near {_two_digits(farthest_m, math.ceil):g}"] if farthest_m > max_range_m else [])


def _two_digits(distance_m: float, rounded: Callable[[float], int]) -> float:
    """A distance of two digits that leaves out nothing of what this one holds."""
    unit = 10.0 ** (math.floor(math.log10(distance_m)) - 1) if distance_m > 0.0 else 1.0
    return rounded(distance_m / unit) * unit


def _in_space(told: list[SemanticMeasurements], world: OpenWorldConfiguration) -> Iterator[Finding]:
    region = SpatialRegion.of(world).reaching(camera_of(told[-1]))
    seen = np.concatenate([seen_from_camera(each, region) for each in told])
    has_range = np.concatenate([np.isfinite(points_of(each)[0]).all(axis=1) for each in told])
    distances_m = np.linalg.norm(seen[has_range], axis=1)
    width_rad, height_rad = 2.0 * np.quantile(np.abs(np.arctan2(seen[:, :2], seen[:, 2:])), REACH, axis=0)
    reach = f"{np.degrees(width_rad):.0f} x {np.degrees(height_rad):.0f} deg about the optical axis"
    if len(distances_m):
        reach += f" and {distances_m.min():.3g} to {distances_m.max():.3g} m"
    fields = np.degrees([2.0 * region.half_width_rad, 2.0 * region.half_height_rad])
    yield from _finding(
        np.concatenate([are_outside(each, region) for each in told]),
        f"{world.min_range_m:g} to {world.max_range_m:g} m, {fields[0]:.0f} x {fields[1]:.0f} deg",
        f"span {reach}",
        _remedy_in_space(region, width_rad, height_rad, distances_m),
    )


def _remedy_in_space(region: SpatialRegion, width_rad: float, height_rad: float, distances_m: Array) -> str:
    """What of the region to enlarge; where no image is so wide, the camera looks elsewhere."""
    if max(width_rad, height_rad) > WIDEST_RAD:
        return "state where the camera looks, by perception.extrinsics: the pose of its optical frame in the body"
    wanted = []
    if not region.by_camera and width_rad > 2.0 * region.half_width_rad:
        wanted.append(f"field_of_view_rad near {width_rad:.2f}")
    if not region.by_camera and height_rad > 2.0 * region.half_height_rad:
        wanted.append(f"vertical_field_of_view_rad near {height_rad:.2f}")
    wanted += _ranges_to_set(distances_m, region.min_range_m, region.max_range_m)
    elsewhere = "perception.extrinsics if it does not look as stated"
    return f"set of open_world {', '.join(wanted)}, as far as the camera sees, or {elsewhere}"


def _finding(outside: Flags, region: str, reach: str, remedy: str) -> Iterator[Finding]:
    """A finding where many of the detections are ``outside`` (N,)."""
    if outside.mean() < MANY:
        return
    yield Finding(
        Severity.ERROR,
        NAME,
        f"{int(outside.sum())} of the first {len(outside)} detections lie outside of open_world's region ({region}) and"
        f" are not used, they {reach}",
        remedy,
    )
