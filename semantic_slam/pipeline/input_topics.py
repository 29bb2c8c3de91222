"""What a bag offers the pipeline."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from semantic_slam.bag.names import absolute
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.topics import TYPES

COPIED = tuple(absolute(topic) for topic in topics.KEPT_INPUTS)
"""Topics that a belief bag takes over from its input."""


@dataclass(frozen=True)
class InputTopics:
    """Absolute names of the topics to read; "" where the bag has none and can do without."""

    odometry: str
    measurements: str  # recorded measurements; "" when they are made of detections
    detections: str
    image: str
    camera_info: str
    depth: str
    identities: str
    transforms: str = ""

    @property
    def has_images(self) -> bool:
        """Whether there is something to classify."""
        return bool(self.image)

    @property
    def has_places_alone(self) -> bool:
        """Whether detections are taken by the places that they tell, without pictures."""
        return not self.image and not self.measurements


def find_topics(path: Path, available: Mapping[str, str]) -> InputTopics:
    """The topics of the bag ``path`` (absolute name -> type); raises InputError that names what is missing."""
    names = {topic: _present(path, topic, available) for topic in TYPES}
    image = names[topics.IMAGE_COMPRESSED] or names[topics.IMAGE]
    required = {topics.ODOMETRY: names[topics.ODOMETRY]}
    recorded = names[topics.MEASUREMENTS] if not image else ""
    if not recorded:
        required[topics.DETECTIONS] = names[topics.DETECTIONS]
    if image:
        required[topics.CAMERA_INFO] = names[topics.CAMERA_INFO]
    missing = [f"{topic} ({TYPES[topic]})" for topic, name in required.items() if not name]
    if missing:
        present = ", ".join(sorted(available)) or "nothing"
        raise InputError(
            f"{path}: no topic {' and no topic '.join(missing)}; it has {present};"
            " import_dataset bag takes topics of other names and types"
        )
    return InputTopics(
        odometry=names[topics.ODOMETRY],
        measurements=recorded,
        detections=names[topics.DETECTIONS],
        image=image,
        camera_info=names[topics.CAMERA_INFO],
        depth=names[topics.DEPTH_COMPRESSED] or names[topics.DEPTH],
        identities=names[topics.GROUND_TRUTH_ASSOCIATIONS],
        transforms=names[topics.TF],
    )


def _present(path: Path, topic: str, available: Mapping[str, str]) -> str:
    """The topic's absolute name, "" when the bag lacks it; raises InputError when it has another type."""
    name = absolute(topic)
    found = available.get(name, "")
    if found and found != TYPES[topic]:
        raise InputError(f"{path}: {name} is {found}, not {TYPES[topic]}; import_dataset bag converts other types")
    return name if found else ""
