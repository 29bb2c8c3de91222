"""How the kitchen is mapped: the configuration for a detector's labels, and what it is compared with."""

from dataclasses import replace

from semantic_slam.configuration import Configuration, KeyframeConfiguration, load_configuration
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.studies.real_kitchen.reference import COUNTS

OURS = "ours"
ALL_LABELS = "all_labels"
SPACINGS = {
    OURS: KeyframeConfiguration(policy="odometry", distance_m=0.1, angle_rad=0.1),
    ALL_LABELS: KeyframeConfiguration(policy="odometry", distance_m=0.1, angle_rad=0.1),
    "keyframes_0.25": KeyframeConfiguration(policy="odometry"),
    "every_frame": KeyframeConfiguration(policy="every_detection"),
}
"""Method -> keyframes. The defaults, 0.25 m and 0.25 rad, are for robots that see things three metres away; here they
are little more than one away. Of every frame, seven a second, what is wrong in one is wrong in the next, too."""
METHODS = tuple(SPACINGS)


def configuration(seed: int) -> Configuration:
    """``config/detector.yaml``."""
    return replace(load_configuration(configuration_file("detector")), seed=seed)


def configuration_of(method: str, base: Configuration) -> Configuration:
    """What is asked for, chairs and cups, by ``perception.labels``; ``all_labels`` maps whatever is detected."""
    labels = () if method == ALL_LABELS else tuple(COUNTS)
    return replace(base, keyframes=SPACINGS[method], perception=replace(base.perception, labels=labels))
