"""Errors of places: those that detections have in common, in a frame or from one to the next, and those of outliers."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class DetectionErrorsConfiguration:
    correlated_share: float = parameter(
        0.0,
        "share of the variance of a detection's place that repeats, in neighbours and in the next views; 0: all is new;"
        " for association: open, or given, with iterate_updates: false",
        minimum=0.0,
        maximum=0.99,
    )
    correlated_shares: tuple[float, ...] = parameter(
        (),
        "in place of correlated_share; which is right is decided by evidence, hypothesis by hypothesis; empty: that"
        " alone",
        distinct=True,
    )
    common_range_share: float = parameter(
        0.3, "share of what repeats in ranges that all detections of a frame have in common", minimum=0.0, maximum=1.0
    )
    common_bearing_share: float = parameter(
        0.7, "share of what repeats in bearings that all detections of a frame have in common", minimum=0.0, maximum=1.0
    )
    neighbour_m: float = parameter(
        0.5,
        "distance between two objects at which they have 60 % of the rest in common; .inf: all objects have all of it",
        minimum=1e-3,
        infinite=True,
    )
    motion_m: float = parameter(
        1.0,
        "metres driven after which errors repeat by a factor of 1 / e; .inf: driving changes none",
        minimum=1e-3,
        infinite=True,
    )
    motion_rad: float = parameter(
        1.0,
        "radians turned after which errors repeat by a factor of 1 / e; .inf: turning changes none",
        minimum=1e-3,
        infinite=True,
    )
    sigma_range_offset_m: float = parameter(
        0.0, "prior sigma of how much all ranges are too long; estimated where correlated_share > 0", minimum=0.0
    )
    sigma_yaw_rad: float = parameter(
        0.0, "prior sigma of how far the sensor is turned about the vertical, likewise [rad]", minimum=0.0
    )
    outlier_share: float = parameter(
        0.0,
        "share of the detections of known objects that err far more than the others, before any is seen; 0: none does;"
        " for association: open, or given, with iterate_updates: false and"
        " semantic_model.kind: none, detector, embedding or detector_embedding",
        minimum=0.0,
        maximum=0.5,
    )
    outlier_counts: float = parameter(
        50.0, "detections that outlier_share counts as; those that a history has had are counted with them", minimum=1.0
    )
    outlier_factor: float = parameter(
        25.0, "covariance of the places of those, in that of others; what repeats does not grow", minimum=1.0
    )
    ray_tail_sigmas: float = parameter(
        0.0,
        "state_space: spatial: standard deviations beyond which a detection without a range counts the less in poses"
        " and places the farther it is off, as one of a Cauchy distribution does; associations are weighed without"
        " that; 0: errors are Gaussian",
        minimum=0.0,
    )
