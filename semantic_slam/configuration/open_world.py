"""Objects that come and go: detection, clutter, births, the sensor's region, merging."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class OpenWorldConfiguration:
    detection_probability: float = parameter(
        0.9, "an object inside the sensor's region and not hidden is detected", minimum=1e-6, maximum=1.0 - 1e-6
    )
    detection_probabilities: tuple[float, ...] = parameter(
        (), "in place of detection_probability; the weight of each value is inferred; empty: that alone", distinct=True
    )
    detection_half_ranges_m: tuple[float, ...] = parameter(
        (),
        "ranges at which an object is detected half as often as right at the sensor (half-normal); the weight of"
        " each value is inferred; empty, or .inf: as often everywhere in the region",
        infinite=True,
        distinct=True,
    )
    detection_by_direction: tuple[float, ...] = parameter(
        (),
        "shares of the detection probability from the right edge of the field of view to its left one, evenly spaced"
        " and linear between them: less than 1 where the sensor sees less; empty: as often in every direction",
    )
    miss_persistence: float = parameter(
        0.0,
        "correlation from keyframe to keyframe of whether an object can be detected; 0: misses are independent",
        minimum=0.0,
        maximum=0.999,
    )
    miss_persistences: tuple[float, ...] = parameter(
        (), "in place of miss_persistence; the weight of each value is inferred; empty: that alone", distinct=True
    )
    clutter_per_frame: float = parameter(0.1, "false alarms expected in a frame, even over the region", minimum=0.0)
    clutters_per_frame: tuple[float, ...] = parameter(
        (), "in place of clutter_per_frame; the weight of each value is inferred; empty: that alone", distinct=True
    )
    second_box_share: float = parameter(
        0.0,
        "probability that an object that is detected has a second box beside it: one thing drawn in halves, or two as"
        " one",
        minimum=0.0,
        maximum=0.9,
    )
    track_error_share: float = parameter(
        0.0,
        "semantic_model.kind: detector, many frames a second: probability that the track of an object goes on with the"
        " box of another; tracks are the detections' track_ids, or boxes that overlap from frame to frame; 0: tracks"
        " tell nothing",
        minimum=0.0,
        maximum=0.5,
    )
    second_box_m: float = parameter(
        0.3, "standard deviation of where such a box is, to each side of the object", minimum=1e-3
    )
    birth_density: float = parameter(
        0.1, "objects per square metre expected where nothing was seen yet, in space per cubic metre", minimum=1e-9
    )
    birth_densities: tuple[float, ...] = parameter(
        (), "in place of birth_density; the weight of each value is inferred; empty: that alone", distinct=True
    )
    rates_ratio: float = parameter(
        1e6,
        "candidate values of the detection, clutter and birth rates are dropped once their weight falls below 1 / this"
        " ratio of the best; keep it large: the density at the start may not be that of the rest of the drive; .inf:"
        " none is dropped",
        minimum=1e6,
        infinite=True,
    )
    departures_per_hour: float = parameter(
        0.0, "rate at which an object that stands leaves for good: what was there is then `missing`", minimum=0.0
    )
    departures_by_label: tuple[str, ...] = parameter(
        (), "that rate by the detector's label, in place of departures_per_hour, whatever the case: [person=30, tree=0]"
    )
    departed_share: float = parameter(
        0.0, "share of the objects of a map that have left since it was made", minimum=0.0, maximum=0.999
    )
    field_of_view_rad: float = parameter(
        1.4, "full angle of the region in which a miss counts", minimum=1e-3, maximum=6.283185307179587
    )
    vertical_field_of_view_rad: float = parameter(
        1.1,
        "state_space: spatial: full angle of that region from the upper to the lower edge of the image;"
        " field_of_view_rad is that from its left edge to its right one",
        minimum=1e-3,
        maximum=3.0,
    )
    region_by_camera: bool = parameter(
        False,
        "state_space: spatial: the region's edges are those of the image, by camera_info, in place of field_of_view_rad"
        " and vertical_field_of_view_rad, which hold where a recording has no camera_info; every frame waits for it",
    )
    direction_rad: float = parameter(
        0.0,
        "bearing of the region's centre in the body frame, counter-clockwise from straight ahead",
        minimum=-3.141592653589793,
        maximum=3.141592653589793,
    )
    min_range_m: float = parameter(0.3, "least range of the region", minimum=0.0)
    max_range_m: float = parameter(5.0, "largest range of the region", minimum=1e-3)
    learn_region: bool = parameter(
        False,
        "the region reaches as far as the detections so far let expect, in place of field_of_view_rad, direction_rad,"
        " min_range_m and max_range_m, which then bound nothing; bearings alone tell no ranges: then the last two hold."
        " direction_rad stays the axis of ranges that are depths",
    )
    learn_region_within_m: float = parameter(
        0.0,
        "learn_region: largest range of the region that is learned; detections beyond, such as false alarms on a far"
        " wall, are left out; 0: none; for association: open",
        minimum=0.0,
    )
    learn_scores: bool = parameter(
        False,
        "detectors' scores so far tell which objects are what the detector looks for; others are said not to exist",
    )
    learn_alarm_scores: bool = parameter(
        False,
        "association: open, with learn_scores: false: learn from scores of objects that later keyframes confirmed or"
        " refuted how likely a rarely seen object exists",
    )
    occluder_radius_m: float = parameter(
        0.25,
        "radius of a detected object, which hides what is behind it; 0: neither it nor the depth image hides anything",
        minimum=0.0,
    )
    least_undetected_share: float = parameter(
        0.02, "share of birth_density left at least where the sensor has looked before", minimum=0.0, maximum=1.0
    )
    least_existence: float = parameter(
        1e-3, "existence below which a hypothesis gives an object up", minimum=0.0, maximum=1.0
    )
    gate_sigma: float = parameter(
        5.0, "Mahalanobis distance up to which a detection may be of a known object", minimum=0.1
    )
    max_joint_objects: int = parameter(
        30, "objects near the detections whose covariance with the robot is computed, per hypothesis", minimum=1
    )
    max_candidates: int = parameter(
        0, "weights.max_candidates of an open world, where a known map has many more; 0: the same", minimum=0
    )
    candidate_gate: float = parameter(
        0.0,
        "weights.gate of an open world, where a known map needs a wider one; 0: the same",
        minimum=0.0,
    )
    joint_ranking: bool = parameter(
        True,
        "where there are more than weights.max_candidates joint assignments, rank them over the pose that detections"
        " share; false: by pairs on their own",
    )
    classes: str = parameter(
        "carried",
        "carried: a table over class and heading for each object; enumerated: hypotheses of their own",
        choices=("carried", "enumerated"),
    )
    iterate_updates: bool = parameter(
        True,
        "iterate every update until it converges; false: one update per keyframe, for drives of kilometres",
        formerly="settle",
    )
    merge_position_m: float = parameter(
        0.1,
        "hypotheses whose robots are so close are merged if all below agrees too; 0: never, .inf: at any distance",
        minimum=0.0,
        infinite=True,
    )
    merge_heading_rad: float = parameter(
        0.05,
        "merging: largest difference of heading, in space of attitude; .inf: any",
        minimum=0.0,
        infinite=True,
    )
    merge_object_m: float = parameter(
        0.15,
        "merging: largest distance between the objects that a recent detection was associated with; .inf: any",
        minimum=0.0,
        infinite=True,
    )
    merge_keyframes: int = parameter(10, "merging: keyframes whose detections count as recent", minimum=1)
    merge_ghosts: bool = parameter(
        False, "merging: hypotheses that differ in which objects exist are copies, too; for drives of kilometres"
    )
    time_budget_ms: float = parameter(
        0.0, "keep fewer hypotheses when a keyframe takes longer; 0: off. Not reproducible when on", minimum=0.0
    )
