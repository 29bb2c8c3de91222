"""Selects which topics of a bag are replayed, and under which names."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from semantic_slam.errors import InputError
from semantic_slam.messages import topics

INPUTS = frozenset(
    {
        topics.DETECTIONS,
        topics.IMAGE,
        topics.IMAGE_COMPRESSED,
        topics.DEPTH,
        topics.DEPTH_COMPRESSED,
        topics.DISPARITY,
        topics.CAMERA_INFO,
        topics.ODOMETRY,
        topics.INITIAL_POSE,
    }
)
NEVER = (topics.CLOCK, topics.DIAGNOSTICS, "/classifier/", "/hypothesis_manager/", "/bag_player/")
"""Topics, or their prefixes, that running nodes publish themselves; recorded ones would mix with those."""
RECORDED_MEASUREMENTS = topics.MEASUREMENTS.lstrip("/")


@dataclass(frozen=True)
class PlayItem:
    """One topic to replay."""

    name: str  # under which it is published, relative but for tf
    type_name: str

    @property
    def is_input(self) -> bool:
        """Whether one of our nodes must subscribe to the topic."""
        return self.name in INPUTS or self.is_frame

    @property
    def is_frame(self) -> bool:
        """Whether its messages are the frames counted by flow control."""
        return self.name in (topics.DETECTIONS, RECORDED_MEASUREMENTS)

    @property
    def is_latched(self) -> bool:
        return self.name in topics.LATCHED or f"/{self.name}" in topics.LATCHED


class Playlist:
    """Topics to replay: ``items`` by absolute topic name in the bag; ``notes`` on topics left out.

    ``has_measurements``: the bag has recorded measurements and no detections, so that the player takes the
    classifier's place.
    """

    def __init__(
        self, types: Mapping[str, str], remaps: Mapping[str, str], is_installed: Callable[[str], bool]
    ) -> None:
        """Raises InputError when a remapped topic is not in the bag."""
        absent = sorted(set(remaps) - set(types))
        if absent:
            raise InputError(f"parameter remap: no topic {absent[0]} in the bag; it has {', '.join(sorted(types))}")
        self.items: dict[str, PlayItem] = {}
        self.notes: list[str] = []
        names = {remaps.get(topic, topic.lstrip("/")) for topic in types}
        self.has_measurements = topics.MEASUREMENTS in types and topics.DETECTIONS not in names
        for topic, type_name in sorted(types.items()):
            if topic.startswith(NEVER) and not (self.has_measurements and topic == topics.MEASUREMENTS):
                continue
            if is_installed(type_name):
                name = remaps.get(topic, topic if topic in topics.GLOBAL else topic.lstrip("/"))
                self.items[topic] = PlayItem(name, type_name)
            else:
                self.notes.append(f"{topic} is not replayed: package {type_name.split('/')[0]} is not installed")


def parse_remaps(entries: Iterable[str]) -> dict[str, str]:
    """Parse entries such as ``/camera/image:=image`` into a dictionary with absolute keys. Raises InputError."""
    remaps = {}
    for entry in filter(None, entries):
        source, separator, target = entry.partition(":=")
        if not (separator and source and target):
            raise InputError(f"parameter remap: '{entry}' is not FROM:=TO; write for example /camera/image:=image")
        remaps["/" + source.lstrip("/")] = (
            target.lstrip("/") if "/" + target.lstrip("/") not in topics.GLOBAL else target
        )
    return remaps
