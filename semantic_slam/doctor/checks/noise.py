"""Check of noise settings: contradicted by the data, or implausibly small."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, Severity, error
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.geometry.pose import planar_from_covariance
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.perception.measurement import SemanticMeasurements

NAME = "noise"
SOME, MUCH = 2.0, 6.0
"""By so much farther than stated detections of one thing lie apart; 0.1 to 0.6 on twelve healthy drives, 3 to 5 in
stretches where most of what is seen moves."""
LEAST_MOTION_M = 0.02
"""Motions shorter than this are ignored for distance-proportional errors."""
EXACT_SHARE = 2e-4
"""Odometry error per distance below which the odometry is implausibly exact."""
EXACT_M, EXACT_RAD = 1e-3, 1e-4
"""Range and bearing errors below which detections are implausibly exact."""


def check(summary: InputSummary) -> Iterator[Finding]:
    yield from _exact_odometry(summary)
    yield from _exact_detections(summary)
    evidence = summary.evidence
    moving = summary.configuration.moving
    least = MUCH if moving.share or moving.share_by_label else SOME
    if evidence.excess > least and not evidence.turn and not evidence.later_s:
        yield Finding(
            Severity.ERROR if evidence.excess > MUCH else Severity.WARNING,
            NAME,
            f"from keyframe to keyframe detections of one thing lie {evidence.excess:.1f} times as far apart as the"
            " noise of odometry and detections allows",
            "find the noise with semantic_slam calibrate, or raise odometry.sigma_* and perception.sigma_* (covariances"
            " that come with detections count first); check the scale of odometry; moving.share is for what moves",
        )


def _exact_odometry(summary: InputSummary) -> Iterator[Finding]:
    shares = []
    for keyframe in summary.keyframes:
        length_m = float(np.linalg.norm(keyframe.odometry[:3]))
        sigma_m = float(np.sqrt(planar_from_covariance(keyframe.odometry_covariance)[0, 0]))
        if length_m > LEAST_MOTION_M and np.isfinite(sigma_m):
            shares.append(sigma_m / length_m)
    if shares and np.median(shares) < EXACT_SHARE:
        yield error(
            NAME,
            f"odometry is said to err by {np.median(shares):.1e} of the way",
            "set odometry.sigma_translation_per_m and sigma_rotation_* to what the robot does (wheels: 0.02 to 0.1), or"
            " find them with semantic_slam calibrate",
        )


def _exact_detections(summary: InputSummary) -> Iterator[Finding]:
    noise = ConfiguredNoise(summary.configuration.odometry, summary.configuration.perception)
    told = [noise.of_detections(m.ranges_m, m.geometric_covariances) for m in _measurements(summary)]
    if not told:
        return
    variances = np.diagonal(np.concatenate(told), axis1=1, axis2=2)
    ranged = variances[np.isfinite(variances[:, 0])]
    if not len(ranged):
        return
    sigma_m, sigma_rad = np.sqrt(np.median(ranged, axis=0))
    if sigma_m < EXACT_M and sigma_rad < EXACT_RAD:
        yield error(
            NAME,
            f"detections are said to err by {sigma_m:.1e} m and {sigma_rad:.1e} rad",
            "set perception.sigma_range_m and sigma_bearing_rad, or the covariances that come with the detections, to"
            " what the detector does",
        )


def _measurements(summary: InputSummary) -> list[SemanticMeasurements]:
    return [each.measurements for each in summary.keyframes if len(each.measurements)]
