"""Check of odometry: steps that no robot makes."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, error, warning
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.geometry.arrays import Array
from semantic_slam.pipeline.odometry.odometry_rate import LEAST_STEPS, Rate

NAME = "odometry"
MANY = 0.1
"""Share of all steps from which on jumps are no single events."""


def check(summary: InputSummary) -> Iterator[Finding]:
    rows, topic = summary.odometry, summary.found.odometry
    steps = _steps(rows)
    if len(steps) <= LEAST_STEPS or (steps[:, 0] < 0.0).any():
        return  # what is wrong with its clock comes first
    rate = Rate(step_s=float(np.median(steps[:, 0])))
    jumps = np.array([rate.is_jump(*step) for step in steps.tolist()])
    if not jumps.any():
        return
    first = int(np.argmax(jumps))
    duration_s, length_m, turn_rad = steps[first]
    what = (
        f"{topic} jumps in {int(jumps.sum())} of {len(steps)} steps, first at {rows[first + 1, 0]:.3f} s by"
        f" {length_m:.3g} m and {np.degrees(turn_rad):.3g} deg in {duration_s:.3g} s"
    )
    if jumps.mean() > MANY:
        yield error(NAME, what, "give poses in metres, by one publisher alone; motion across a jump is not used")
    else:
        remedy = "have its publisher correct poses in map, not in odom (REP 105), and look for resets"
        yield warning(NAME, what, f"{remedy}; motion across a jump counts as missing")


def _steps(rows: Array) -> Array:
    """(N - 1, 3) duration [s], length [m] and absolute turn [rad] of each step of ``InputSummary.odometry``."""
    steps = np.diff(rows, axis=0)
    turns = np.abs((steps[:, 3] + np.pi) % (2.0 * np.pi) - np.pi)
    return np.stack([steps[:, 0], np.hypot(steps[:, 1], steps[:, 2]), turns], axis=1)
