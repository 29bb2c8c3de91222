"""Gravity by an inertial sensor, topic imu."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class ImuConfiguration:
    sigma_level_rad: float = parameter(
        0.02,
        "state_space: spatial: standard deviation [rad] of roll and pitch by topic imu, where its"
        " orientation_covariance does not state it; odometry.level_repeats_s holds; 0: the topic is not used",
        minimum=0.0,
    )
    extrinsics: tuple[float, ...] = parameter(
        (), "T_base_imu as x y z qx qy qz qw; empty: from /tf_static", lengths=(0, 7)
    )
    window_s: float = parameter(
        1.0,
        "time [s] before a keyframe over which accelerations are averaged where messages state no orientation",
        minimum=0.05,
        maximum=10.0,
    )
    most_acceleration_m_s2: float = parameter(
        1.0,
        "keyframes at which the robot accelerates by more, by its odometry, or what is left of the mean differs by more"
        " from gravity, have none by accelerations",
        minimum=0.0,
    )
