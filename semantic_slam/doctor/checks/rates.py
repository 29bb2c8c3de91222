"""Check of rates: odometry too slow for the keyframes."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.doctor.input_summary import InputSummary

NAME = "rates"
SLOWER = 2.0
"""Tolerated ratio of the odometry period to the detection period."""
LONG_M, LONG_RAD = 0.2, 0.2
"""Motion between two samples above which linear interpolation is inaccurate."""


def check(summary: InputSummary) -> Iterator[Finding]:
    odometry, seen = summary.stamps_of(summary.found.odometry), summary.stamps_of(summary.measured)
    if min(len(odometry), len(seen)) < 3:
        return
    slow_s, fast_s = odometry.usual_step_s, seen.usual_step_s
    if slow_s <= SLOWER * fast_s:
        return
    length_m, turn_rad = _motion_per_sample(summary)
    is_long = length_m > LONG_M or turn_rad > LONG_RAD
    yield Finding(
        Severity.ERROR if is_long else Severity.WARNING,
        NAME,
        f"{summary.found.odometry} comes every {slow_s:.3g} s and {summary.measured} every {fast_s:.3g} s; between two"
        f" samples the robot moves {length_m:.2g} m and turns {np.degrees(turn_rad):.2g} deg (median)",
        "record odometry at its full rate, at least as often as detections; motion between samples is interpolated",
    )


def _motion_per_sample(summary: InputSummary) -> tuple[float, float]:
    """Median length [m] and turn [rad] from one odometry sample to the next."""
    if len(summary.odometry) < 2:
        return 0.0, 0.0
    steps = np.diff(summary.odometry, axis=0)
    turns = np.abs((steps[:, 3] + np.pi) % (2.0 * np.pi) - np.pi)
    return float(np.median(np.hypot(steps[:, 1], steps[:, 2]))), float(np.median(turns))
