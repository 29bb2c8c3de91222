"""Selects which topics of a bag are replayed, and under which names."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from semantic_slam.bag.names import absolute
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.pipeline.input_topics import mistyped, offered
from semantic_slam.ros.wire import qos

PICTURES = frozenset(map(absolute, qos.PICTURES))
NEVER = (topics.CLOCK, topics.DIAGNOSTICS, "/classifier/", "/hypothesis_manager/", "/bag_player/")
"""Topics, or their prefixes, that running nodes publish themselves; recorded ones would mix with those."""
RECORDED_MEASUREMENTS = topics.MEASUREMENTS.lstrip("/")


@dataclass(frozen=True)
class PlayItem:
    """One topic to replay."""

    name: str  # under which it is published, relative but for tf
    type_name: str
    is_input: bool  # whether one of our nodes must subscribe to it

    @property
    def is_frame(self) -> bool:
        """Whether its messages are the frames counted by flow control."""
        return self.name in (topics.DETECTIONS, RECORDED_MEASUREMENTS)

    @property
    def is_latched(self) -> bool:
        return self.name in topics.LATCHED or f"/{self.name}" in topics.LATCHED


class Playlist:
    """Topics to replay: ``items`` by absolute topic name in the bag; ``notes`` on topics left out.

    ``has_measurements``: recorded measurements are replayed, as there are no pictures or no detections to make them
    from; the player takes the classifier's place.
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
        names = {
            topic: remaps.get(topic, topic if topic in topics.GLOBAL else topic.lstrip("/")) for topic in sorted(types)
        }
        kinds = {absolute(name): types[topic] for topic, name in names.items()}
        is_measurable = topics.DETECTIONS in names.values() and bool(offered(kinds).image)
        self.has_measurements = topics.MEASUREMENTS in types and not is_measurable
        inputs = _inputs({name: kind for name, kind in kinds.items() if is_installed(kind)}, self.has_measurements)
        depth = "" if self.has_measurements else _depth(kinds)
        for topic, name in names.items():
            if topic.startswith(NEVER) and not (self.has_measurements and topic == topics.MEASUREMENTS):
                continue
            if self.has_measurements and name == topics.DETECTIONS:
                self.notes.append(f"{topic} is not replayed: the recorded measurements of its detections are")
            elif is_installed(types[topic]):
                self.items[topic] = PlayItem(name, types[topic], is_input=absolute(name) in inputs)
            else:
                effect = ", so bearings alone" if absolute(name) == depth else ""
                package = types[topic].split("/")[0]
                self.notes.append(f"{topic} is not replayed: package {package} is not installed{effect}")

    @property
    def frames(self) -> list[str]:
        """Topics of the bag whose messages are the frames counted by flow control."""
        return [topic for topic, item in self.items.items() if item.is_frame]

    def named(self, name: str) -> list[str]:
        """Topics of the bag that are published under a relative name."""
        return [topic for topic, item in self.items.items() if item.name == name]


def _inputs(kinds: Mapping[str, str], has_measurements: bool) -> set[str]:
    """Topics, of those replayed with these types, that our nodes subscribe to, all by absolute name.

    Colour and depth are read from one topic each, and depth only of images; with recorded measurements there is no
    classifier, which would read both. Pictures of a wrong type count, too, as nobody listens to them: that is told.
    """
    of_manager = {absolute(topic) for topic in (topics.ODOMETRY, topics.INITIAL_POSE)}
    if has_measurements:
        return {*of_manager, topics.MEASUREMENTS}
    of_classifier = {absolute(topic) for topic in (topics.DETECTIONS, topics.CAMERA_INFO)}
    pictures = {offered(kinds).image, _depth(kinds)} | (mistyped(kinds).keys() & PICTURES)
    return of_manager | of_classifier | pictures


def _depth(kinds: Mapping[str, str]) -> str:
    """Topic from which the depth of images is read, "" for none."""
    found = offered(kinds)
    return found.depth if found.has_images else ""


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
