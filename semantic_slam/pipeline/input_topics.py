"""Finds the topics of a bag that the pipeline reads."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from semantic_slam.bag.names import absolute
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.topics import TYPES

COPIED = tuple(absolute(topic) for topic in topics.KEPT_INPUTS)
"""Topics that are copied from the input bag into the belief bag."""
OPTIONAL = frozenset({topics.IMU, topics.DISPARITY})
"""Topics that a run does without, also where a topic of their name has another type."""
BY_NAME = {absolute(topic): kind for topic, kind in TYPES.items() if topic not in OPTIONAL}
"""Required type by absolute topic name, without the optional ones."""


@dataclass(frozen=True)
class InputTopics:
    """Absolute names of the topics to read; "" for one that the bag does not have."""

    odometry: str
    measurements: str  # recorded measurements; "" if they are made from detections
    detections: str
    image: str
    camera_info: str
    depth: str  # depth images, or disparities
    identities: str
    transforms: str = ""
    imu: str = ""

    @property
    def has_images(self) -> bool:
        """Whether there are images to classify."""
        return bool(self.image)

    @property
    def has_places_alone(self) -> bool:
        """Whether detections are used by their positions, without images."""
        return not self.image and not self.measurements


def find_topics(path: Path, available: Mapping[str, str]) -> InputTopics:
    """The topics to read, of those ``available`` in the bag (absolute name -> type); raises InputError if some lack."""
    for topic, kind in mistyped(available).items():
        raise InputError(f"{path}: {topic} is {kind}, not {BY_NAME[topic]}; import_dataset bag converts other types")
    found = offered(available)
    missing = [f"{topic} ({TYPES[topic]})" for topic in lacking(found)]
    if missing:
        present = ", ".join(sorted(available)) or "nothing"
        raise InputError(
            f"{path}: no topic {' and no topic '.join(missing)}; it has {present};"
            " import_dataset bag takes topics of other names and types"
        )
    return found


def mistyped(available: Mapping[str, str]) -> dict[str, str]:
    """Types of the topics, by absolute name, that have another type than required."""
    return {topic: available[topic] for topic, kind in BY_NAME.items() if available.get(topic, kind) != kind}


def offered(available: Mapping[str, str]) -> InputTopics:
    """The available topics that can be read, whether or not they suffice for a run."""
    names = {topic: absolute(topic) if available.get(absolute(topic)) == kind else "" for topic, kind in TYPES.items()}
    image = names[topics.IMAGE_COMPRESSED] or names[topics.IMAGE]
    return InputTopics(
        odometry=names[topics.ODOMETRY],
        measurements=names[topics.MEASUREMENTS] if not image else "",
        detections=names[topics.DETECTIONS],
        image=image,
        camera_info=names[topics.CAMERA_INFO],
        depth=names[topics.DEPTH_COMPRESSED] or names[topics.DEPTH] or names[topics.DISPARITY],
        identities=names[topics.GROUND_TRUTH_ASSOCIATIONS],
        transforms=names[topics.TF],
        imu=names[topics.IMU],
    )


def lacking(found: InputTopics) -> list[str]:
    """Relative names of missing topics without which no run is possible."""
    required = {topics.ODOMETRY: found.odometry}
    if not found.measurements:
        required[topics.DETECTIONS] = found.detections
    if found.image:
        required[topics.CAMERA_INFO] = found.camera_info
    return [topic for topic, name in required.items() if not name]
