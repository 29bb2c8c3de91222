"""Where the robot starts."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class InitialPoseConfiguration:
    mean: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "x, y [m], yaw [rad] in map, used when nothing on topic initialpose says else", lengths=(3,)
    )
    sigma: tuple[float, ...] = parameter((0.1, 0.1, 0.05), "standard deviations of x, y [m], yaw [rad]", lengths=(3,))
