"""Which frames become keyframes."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class KeyframeConfiguration:
    policy: str = parameter(
        "every_detection", "which detection frames become keyframes", choices=("every_detection", "odometry")
    )
    distance_m: float = parameter(
        0.25,
        "odometry policy: distance since the last keyframe; .inf: angle_rad alone counts",
        minimum=0.0,
        infinite=True,
    )
    angle_rad: float = parameter(
        0.25,
        "odometry policy: angle since the last keyframe; .inf: distance_m alone counts",
        minimum=0.0,
        infinite=True,
    )
