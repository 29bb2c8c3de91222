"""Noise of odometry, and its constant errors, which may be estimated."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class OdometryConfiguration:
    sigma_translation_per_m: float = parameter(0.06, "standard deviation of x and y per metre driven", minimum=0.0)
    sigma_rotation_per_m: float = parameter(0.035, "standard deviation of yaw [rad] per metre driven", minimum=0.0)
    sigma_rotation_per_rad: float = parameter(0.05, "standard deviation of yaw [rad] per radian turned", minimum=0.0)
    sigma_translation_floor_m: float = parameter(0.01, "least standard deviation of x and y per keyframe", minimum=1e-6)
    sigma_rotation_floor_rad: float = parameter(0.005, "least standard deviation of yaw per keyframe", minimum=1e-6)
    sigma_out_of_plane_translation_per_m: float = parameter(
        0.0,
        "state_space: spatial: standard deviation of z along the body's axis per metre driven, of a robot on wheels,"
        " where odometry states no covariance; without a floor and a part by turning; 0: that of x and y",
        minimum=0.0,
    )
    sigma_out_of_plane_rotation_per_m: float = parameter(
        0.0,
        "state_space: spatial: standard deviation of roll and pitch [rad] per metre driven, likewise; 0: that of yaw",
        minimum=0.0,
    )
    noise_factors: tuple[float, ...] = parameter(
        (1.0,),
        "association: open, or given with iterate_updates: false: factors on the covariance, of which every hypothesis"
        " has one; evidence decides, and has to be very strong, 150 to 1, for one below 1",
        distinct=True,
    )
    slip_share: float = parameter(
        0.0,
        "association: open, or given with iterate_updates: false, in the plane: share of the motions from one keyframe"
        " to the next in which odometry slips, as wheels do that spin or are lifted for a moment; 0: it never does",
        minimum=0.0,
        maximum=0.5,
    )
    sigma_slip_m: float = parameter(
        0.1,
        "slip_share: standard deviation of x and y by which such a motion is off, beside that of all others",
        minimum=1e-6,
    )
    sigma_slip_rad: float = parameter(
        0.1, "slip_share: standard deviation of the heading by which it is, likewise", minimum=1e-6
    )
    estimate_bias: bool = parameter(
        False,
        "estimate a constant error per metre with the poses; for association: open, or given, with"
        " iterate_updates: false",
    )
    bias_rad_per_m: float = parameter(0.0, "estimate_bias: heading error per metre expected before the drive")
    sigma_bias_rad_per_m: float = parameter(
        0.003, "estimate_bias: standard deviation of the heading error per metre before the drive", minimum=1e-9
    )
    bias_scale: float = parameter(0.0, "estimate_bias: relative error of the distance expected before the drive")
    sigma_bias_scale: float = parameter(
        0.02, "estimate_bias: standard deviation of the relative error of the distance before the drive", minimum=1e-9
    )
    bias_turn_scale: float = parameter(0.0, "estimate_bias: relative error of the turns expected before the drive")
    sigma_bias_turn_scale: float = parameter(
        0.0,
        "estimate_bias: standard deviation of the relative error of the turns before the drive; 0: it is as expected",
        minimum=0.0,
    )
    clock_offset_s: float = parameter(
        0.0, "how much later [s] odometry is stamped than detections of that instant, as expected before the drive"
    )
    sigma_clock_offset_s: float = parameter(
        0.0,
        "estimate_bias: standard deviation [s] of clock_offset_s before the drive; 0: it is as expected",
        minimum=0.0,
    )
    sigma_level_rad: float = parameter(
        0.0,
        "state_space: spatial: standard deviation [rad] of roll and pitch in odometry's poses, whose frame is level"
        " by gravity (visual-inertial odometry, or one that an IMU corrects); 0: only motions count",
        minimum=0.0,
    )
    level_repeats_s: float = parameter(
        10.0,
        "sigma_level_rad: time [s] within which errors of roll and pitch repeat; looks closer count as one",
        minimum=0.0,
    )
