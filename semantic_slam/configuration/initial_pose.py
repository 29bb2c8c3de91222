"""Where the robot starts."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class InitialPoseConfiguration:
    mean: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0),
        "x, y [m], yaw [rad] in map, used when nothing on topic initialpose says else; state_space: spatial: x, y, z,"
        " roll, pitch, yaw",
        lengths=(3, 6),
    )
    sigma: tuple[float, ...] = parameter(
        (0.1, 0.1, 0.05),
        "standard deviations of x, y [m], yaw [rad]; state_space: spatial: along and about x, y and z of map",
        lengths=(3, 6),
    )
