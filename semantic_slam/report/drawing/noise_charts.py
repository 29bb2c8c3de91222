"""Charts of the inferred noise of robot and sensor, per keyframe."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.report.drawing.charts import Chart, Key, keyframes, time_plot

MEANINGS = {
    "odometry.bias_rad_per_m": "Turn that odometry leaves out in every metre, in radians.",
    "odometry.bias_scale": "Share of every metre that odometry leaves out.",
    "odometry.bias_turn_scale": "Share of every turn that odometry leaves out.",
    "odometry.clock_offset_s": "Seconds by which odometry is stamped later than detections of that instant.",
    "odometry.noise_factor": "Factor on the covariance of odometry.",
    "odometry.slipped": "Probability that odometry slipped from the keyframe before.",
    "perception.noise_factor": "Factor on the covariance of a detection's place.",
    "perception.ranges_are_depth": "Probability that a detection's range is its depth along the sensor's axis.",
    "detection_errors.correlated_share": "Share of the variance of a detection's place that repeats in the next views.",
    "detection_errors.range_offset_m": "Metres by which all ranges are too long.",
    "detection_errors.yaw_rad": "Radians by which all bearings are too far to the left.",
    "open_world.detection_probability": "Of an object right at the sensor that nothing hides.",
    "open_world.detection_half_range_m": "Metres, at which it is half of that.",
    "open_world.miss_persistence": "Correlation from keyframe to keyframe of whether an object can be detected.",
    "open_world.clutter_per_frame": "False alarms expected in a frame.",
    "open_world.birth_density": "Objects per square metre where nothing was seen yet.",
    "open_world.min_range_m": "Metres; as near as the detections so far, with a margin.",
    "open_world.max_range_m": "Metres; as far as the detections so far, with a margin.",
    "open_world.field_of_view_rad": "Radians; as wide as the detections so far, with a margin.",
    "open_world.direction_rad": "Radians; bearing of the middle of the sensor's region.",
}

SIGNED = {
    *("odometry.bias_rad_per_m", "odometry.bias_scale", "odometry.bias_turn_scale", "odometry.clock_offset_s"),
    *("detection_errors.range_offset_m", "detection_errors.yaw_rad", "open_world.direction_rad"),
}
"""Quantities that may be negative."""
SHARES = {
    *("odometry.slipped", "perception.ranges_are_depth", "detection_errors.correlated_share"),
    *("open_world.detection_probability", "open_world.miss_persistence"),
}
"""Quantities from 0 to 1."""
IN_SPACE = {"open_world.birth_density": "Objects per cubic metre where nothing was seen yet."}
"""Meanings of quantities whose unit is another one in space."""


def noise_charts(beliefs: tuple[HybridBelief, ...]) -> list[Chart]:
    """A chart of each quantity that the last belief names, and of which some belief has a finite mean."""
    names = beliefs[-1].noise_names
    return [_course(beliefs, name) for name in names if np.isfinite(noise_course(beliefs, name)[0]).any()]


def noise_course(beliefs: tuple[HybridBelief, ...], name: str) -> tuple[Array, Array]:
    """(K,) mean and standard deviation of one quantity, NaN where a belief does not tell, or has an infinite mean."""
    means_and_sigmas = [
        (belief.noise_values[at], belief.noise_sigmas[at])
        if (at := _place(belief, name)) is not None
        else (np.nan, np.nan)
        for belief in beliefs
    ]
    values, sigmas = np.array(means_and_sigmas).T
    return np.where(np.isfinite(values), values, np.nan), sigmas


def _place(belief: HybridBelief, name: str) -> int | None:
    return belief.noise_names.index(name) if name in belief.noise_names else None


def _limits(name: str) -> tuple[float, float]:
    """The least and the largest value that a quantity can have; a band of one standard deviation ends there."""
    least = 0.0 if name in MEANINGS and name not in SIGNED else -np.inf
    return least, 1.0 if name in SHARES else np.inf


def _course(beliefs: tuple[HybridBelief, ...], name: str) -> Chart:
    values, sigmas = noise_course(beliefs, name)
    spread, (least, most) = np.nan_to_num(sigmas), _limits(name)
    low, high = np.clip(values - spread, least, most), np.clip(values + spread, least, most)
    bottom, top = float(np.nanmin(low)), float(np.nanmax(high))
    room = 0.08 * (top - bottom) or max(0.1 * abs(top), 1e-3)
    plot = time_plot(beliefs, max(bottom - room, least), top + room, name)
    with_band = np.isfinite(sigmas)
    if with_band.any():
        plot.area(keyframes(beliefs)[with_band], low[with_band], high[with_band], "#e4eef8")
    plot.axes()
    plot.line(keyframes(beliefs), values, "line first")
    text = IN_SPACE.get(name, "") if not beliefs[-1].planar else ""
    text = text or MEANINGS.get(name, "")
    band = "Shaded: one standard deviation, over the hypotheses." if with_band.any() else ""
    return Chart(
        name, f"{text} {band}".strip(), [Key("first", "mean" if band else "value", values.tolist())], plot.svg()
    )
