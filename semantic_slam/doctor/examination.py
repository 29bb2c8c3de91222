"""All checks of an input, in the order in which a user would fix the faults."""

from collections.abc import Callable, Iterable

from semantic_slam.doctor.checks import (
    boxes,
    clocks,
    depth,
    drops,
    extrinsics,
    frames,
    imu,
    intrinsics,
    labels,
    map_prior,
    matching,
    noise,
    odometry,
    rates,
    raw_pictures,
    region,
    scores,
    settings,
    stamps,
    topics,
)
from semantic_slam.doctor.finding import Finding
from semantic_slam.doctor.input_summary import InputSummary

CHECKS: tuple[Callable[[InputSummary], Iterable[Finding]], ...] = (
    topics.check,
    settings.check,
    map_prior.check,
    frames.check,
    stamps.check,
    clocks.check,
    rates.check,
    odometry.check,
    raw_pictures.check,
    matching.check,
    intrinsics.check,
    extrinsics.check,
    imu.check,
    depth.check,
    boxes.check,
    labels.check,
    scores.check,
    region.check,
    noise.check,
    drops.check,
)


def examine(summary: InputSummary) -> list[Finding]:
    """Run all checks; returns the findings, an empty list for a healthy input."""
    found = [finding for check in CHECKS for finding in check(summary)]
    return [*found, *drops.check_last(summary, found)]
