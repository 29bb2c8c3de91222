"""Check of the sensor region: detections outside the configured one."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.open_world.planar.region import sensor_region

NAME = "region"
SOME, MOST = 0.2, 0.8
"""Share of all detections."""
REACH = 0.99
"""Share of them that the remedy's numbers hold."""


def check(summary: InputSummary) -> Iterator[Finding]:
    configuration, world = summary.configuration, summary.configuration.open_world
    if not strategy_of(configuration).counts_misses or world.learn_region or summary.evidence.turn:
        return
    told = [each.measurements for each in summary.keyframes if len(each.measurements)]
    if not told:
        return
    ranges_m = np.concatenate([each.ranges_m for each in told])
    bearings_rad = np.concatenate([each.bearings_rad for each in told])
    outside = ~sensor_region(world).holds(ranges_m, bearings_rad)
    if outside.mean() <= SOME:
        return
    reach_m = float(np.nanquantile(ranges_m, REACH)) if np.isfinite(ranges_m).any() else float("nan")
    aside_rad = float(np.quantile(np.abs(bearings_rad), REACH))
    region = f"{world.min_range_m:g} to {world.max_range_m:g} m, {np.degrees(world.field_of_view_rad):.0f} deg"
    yield Finding(
        Severity.ERROR if outside.mean() > MOST else Severity.WARNING,
        NAME,
        f"{int(outside.sum())} of the first {len(outside)} detections lie outside of open_world's region ({region}) and"
        f" are not used, they reach to {reach_m:.3g} m and {np.degrees(aside_rad):.0f} deg aside",
        f"set open_world.max_range_m near {reach_m:.2g} and field_of_view_rad near"
        f" {min(2.0 * aside_rad, 2.0 * np.pi):.2g}, as far as the sensor sees, or open_world.learn_region: true",
    )
