"""Selection of a user bag's topics (image, odometry, ...): by given name, or by type where unique."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from semantic_slam.datasets.user_bag.detection_formats import IN_THE_SENSOR, READERS
from semantic_slam.errors import InputError
from semantic_slam.messages import topics

IMAGE_TYPES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
DISPARITY_TYPE = topics.TYPES[topics.DISPARITY]
DEPTH_TYPES = (*IMAGE_TYPES, DISPARITY_TYPE)
CAMERA_INFO_TYPES = ("sensor_msgs/msg/CameraInfo",)
OURS = topics.TYPES[topics.DETECTIONS]
NONE = "none"
"""Given as a topic's name: do without it."""
STATIC = "_static"
"""What the name of a topic of static transforms ends with, in whatever namespace."""
NEEDS_COLOUR = "as it needs colour images, which --image names"
"""Why depth is not used where there are no pictures."""


@dataclass(frozen=True)
class Topic:
    """One topic that has messages."""

    name: str
    type_name: str

    def __str__(self) -> str:
        return f"{self.name} ({self.type_name})"


@dataclass(frozen=True)
class Wanted:
    """Names given on the command line; None: find it."""

    detections: str | None = None
    image: str | None = None
    depth: str | None = None
    camera_info: str | None = None
    odometry: str | None = None
    imu: str | None = None
    tf_static: str | None = None


@dataclass(frozen=True)
class Selection:
    """The topics to import."""

    detections: Topic
    image: Topic | None  # None: no pictures, detections tell places
    depth: Topic | None  # depth images, or disparities of a stereo pair; None: bearing only
    camera_info: Topic | None  # None: detections are no boxes
    odometry: Topic  # nav_msgs/Odometry, or /tf
    imu: Topic | None = None  # None: none, or none of several is named
    idle_depths: tuple[Topic, ...] = ()  # depth that would be used if there were an image
    tf_static: Topic | None = None  # None: the bag has no static transforms

    @property
    def moving_transforms(self) -> str:
        """Name of the topic of transforms that change, beside that of the static ones."""
        return topics.TF if self.tf_static is None else self.tf_static.name.removesuffix(STATIC)


def select_topics(
    origin: str, available: Sequence[Topic], wanted: Wanted, is_depth: Callable[[Topic], bool]
) -> Selection:
    """The topics to import from the bag ``origin``; ``is_depth`` looks into an image topic. Raises InputError."""
    finder = _Finder(origin, tuple(topic for topic in available if not topic.name.startswith("/ground_truth/")))
    detections = finder.one("detections", wanted.detections, tuple(READERS))
    odometry, imu = _odometry(finder, wanted.odometry), _imu(finder, wanted.imu)
    fixed = _tf_static(finder, wanted.tf_static)
    if detections.type_name in IN_THE_SENSOR:
        finder.refuse(("image", "depth", "camera-info"), wanted, f"as {detections} tells positions")
        return Selection(detections, None, None, None, odometry, imu, tf_static=fixed)
    colour, depths = finder.images(is_depth)
    depths = depths or finder.of_type((DISPARITY_TYPE,))
    image = finder.at_most_one("image", wanted.image, IMAGE_TYPES, colour)
    if image is None:
        finder.refuse(("depth",), wanted, NEEDS_COLOUR)
    depth = None if image is None else finder.at_most_one("depth", wanted.depth, DEPTH_TYPES, depths)
    camera_info = _camera_info(finder, wanted.camera_info, image, is_needed=detections.type_name != OURS)
    is_idle = image is None and camera_info is not None and wanted.depth is None
    return Selection(detections, image, depth, camera_info, odometry, imu, tuple(depths) if is_idle else (), fixed)


def _camera_info(finder: "_Finder", wanted: str | None, image: Topic | None, *, is_needed: bool) -> Topic | None:
    """The image's intrinsics, else the only ones; without an image and a need for them there may be none."""
    infos = finder.of_type(CAMERA_INFO_TYPES)
    beside = [info for info in infos if image and _namespace(info.name) == _namespace(_plain(image.name))]
    find = finder.one if image is not None or is_needed else finder.at_most_one
    return find("camera-info", wanted, CAMERA_INFO_TYPES, beside or infos)


def _odometry(finder: "_Finder", wanted: str | None) -> Topic:
    """nav_msgs/Odometry when there is any, else TF."""
    types = (topics.TYPES[topics.ODOMETRY], topics.TYPES[topics.TF])
    candidates = finder.of_type(types[:1]) or [
        topic for topic in finder.of_type(types[1:]) if not topic.name.endswith(topics.TF_STATIC)
    ]
    return finder.one("odom", wanted, types, candidates)


def _tf_static(finder: "_Finder", wanted: str | None) -> Topic | None:
    """The one that is named, else that without a namespace, else the only one."""
    types = (topics.TYPES[topics.TF_STATIC],)
    found = [topic for topic in finder.of_type(types) if topic.name.endswith(topics.TF_STATIC)]
    usual = [topic for topic in found if topic.name == topics.TF_STATIC]
    return finder.at_most_one("tf-static", wanted, types, usual or found)


def _imu(finder: "_Finder", wanted: str | None) -> Topic | None:
    """The one that is named, else the only one: a run does without, so that several are no reason to ask."""
    types = (topics.TYPES[topics.IMU],)
    found = finder.of_type(types)
    return None if wanted is None and len(found) > 1 else finder.at_most_one("imu", wanted, types, found)


@dataclass(frozen=True)
class _Finder:
    origin: str
    available: tuple[Topic, ...]

    def of_type(self, types: Sequence[str]) -> list[Topic]:
        return [topic for topic in self.available if topic.type_name in types]

    def images(self, is_depth: Callable[[Topic], bool]) -> tuple[list[Topic], list[Topic]]:
        """Colour and depth image topics; one of each transport of the same images, compressed before raw."""
        candidates = self.of_type(IMAGE_TYPES)
        compressed = {_plain(topic.name) for topic in candidates if topic.type_name == IMAGE_TYPES[0]}
        candidates = [
            topic for topic in candidates if topic.type_name == IMAGE_TYPES[0] or topic.name not in compressed
        ]
        depths = [topic for topic in candidates if is_depth(topic)]
        return [topic for topic in candidates if topic not in depths], depths

    def named(self, flag: str, name: str, types: Sequence[str]) -> Topic:
        for topic in self.available:
            if topic.name.lstrip("/") == name.lstrip("/"):
                if topic.type_name in types:
                    return topic
                raise InputError(f"{self.origin}: --{flag} {topic} must be of type {' or '.join(types)}")
        raise InputError(
            f"{self.origin}: no messages on --{flag} {name}; topics that have some: {self._listing(self.available)}"
        )

    def refuse(self, flags: Sequence[str], wanted: Wanted, reason: str) -> None:
        """Raise InputError where one of these flags names a topic that would not be used."""
        for flag in flags:
            name = getattr(wanted, flag.replace("-", "_"))
            if name not in (None, NONE):
                raise InputError(f"{self.origin}: --{flag} {name} would not be used, {reason}; leave it out")

    def at_most_one(
        self, flag: str, name: str | None, types: Sequence[str], candidates: Sequence[Topic]
    ) -> Topic | None:
        if name == NONE or (name is None and not candidates):
            return None
        return self.one(flag, name, types, candidates)

    def one(
        self, flag: str, name: str | None, types: Sequence[str], candidates: Sequence[Topic] | None = None
    ) -> Topic:
        """The topic called ``name``, else the only candidate (by default: of those types)."""
        if name is not None:
            return self.named(flag, name, types)
        found = self.of_type(types) if candidates is None else candidates
        if len(found) == 1:
            return found[0]
        if found:
            raise InputError(f"{self.origin}: --{flag} could be any of {self._listing(found)}; name one")
        raise InputError(
            f"{self.origin}: no topic for --{flag} (type {' or '.join(types)});"
            f" topics that have messages: {self._listing(self.available)}"
        )

    @staticmethod
    def _listing(found: Sequence[Topic]) -> str:
        return ", ".join(str(topic) for topic in found) or "none"


def _namespace(name: str) -> str:
    return name.rpartition("/")[0]


def _plain(name: str) -> str:
    """Name of the raw topic behind a transport's topic."""
    for suffix in ("/compressed", "/compressedDepth"):
        name = name.removesuffix(suffix)
    return name
