"""``import_dataset bag``: a ROS 2 bag of the user's own, with any detector, as an input bag."""

import argparse
from collections import Counter
from contextlib import suppress
from pathlib import Path

from tqdm import tqdm

from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.bag.writer import BagWriter
from semantic_slam.datasets.user_bag.image_formats import is_depth
from semantic_slam.datasets.user_bag.label_map import LabelMap, read_label_map
from semantic_slam.datasets.user_bag.topics import NEEDS_COLOUR, NONE, Selection, Topic, Wanted, select_topics
from semantic_slam.datasets.user_bag.user_bag import Converter
from semantic_slam.errors import InputError
from semantic_slam.messages import topics


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset bag``."""
    parser.add_argument("source", type=Path, metavar="SRC", help="rosbag2 folder, .mcap or .db3")
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    parser.add_argument("--labels", type=Path, metavar="YAML", help="detector label: our label, or null to drop it")
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N detection messages")
    group = parser.add_argument_group("topics", "found by type when left out, as far as that is unique")
    group.add_argument(
        "--detections", metavar="TOPIC", help="of vision_msgs, yolo_msgs, semantic_inference_msgs or ours"
    )
    group.add_argument("--image", metavar="TOPIC", help=f"colour images, raw or compressed; '{NONE}': places alone")
    group.add_argument("--depth", metavar="TOPIC", help=f"depth registered to the image; '{NONE}': bearing only")
    group.add_argument("--camera-info", metavar="TOPIC", help="intrinsics of the image")
    group.add_argument("--odom", metavar="TOPIC", help="nav_msgs/Odometry, or /tf for the transform odom -> base_link")
    group.add_argument("--imu", metavar="TOPIC", help=f"inertial sensor, for runs in space; '{NONE}': do without")
    group.add_argument(
        "--tf-static", metavar="TOPIC", help=f"static transforms, in whatever namespace; '{NONE}': do without"
    )
    group.add_argument("--odom-frame", default="odom", metavar="FRAME", help="with TF: odometry frame (default: odom)")
    group.add_argument(
        "--base-frame",
        default="base_link",
        metavar="FRAME",
        help="body, of TF or of positions (default: base_link)",
    )


def run(arguments: argparse.Namespace, bag: Path) -> InputError | None:
    """Write the bag and say what was used and what was dropped; returns the source's damage. Raises InputError."""
    labels = read_label_map(arguments.labels) if arguments.labels else LabelMap()
    wanted = Wanted(
        arguments.detections,
        arguments.image,
        arguments.depth,
        arguments.camera_info,
        arguments.odom,
        arguments.imu,
        arguments.tf_static,
    )
    with BagReader(arguments.source) as reader:
        reader.check_definitions()
        selection = find_topics(reader, wanted)
        print(describe(selection))
        with BagWriter(bag) as writer:
            converter = Converter(reader, writer, selection, labels, arguments.odom_frame, arguments.base_frame)
            try:
                fault = convert(reader, converter, arguments.max_keyframes)
            finally:
                print("\n".join(summary(arguments.out, converter, labels)))
    if fault is None:
        converter.check_complete()
    return fault


def find_topics(reader: BagReader, wanted: Wanted) -> Selection:
    """Choose among the topics that have messages; raises InputError."""

    def shows_depth(topic: Topic) -> bool:
        with suppress(TruncatedBagError):  # damage before the first image; it is reported when the bag is converted
            first = next(reader.messages([topic.name]))
            return is_depth(reader.decode(first.cdr, first.type_name))
        return False

    available = [Topic(name, kind) for name, kind in sorted(reader.topics.items()) if reader.counts[name]]
    return select_topics(str(reader.path), available, wanted, shows_depth)


def convert(reader: BagReader, converter: Converter, max_keyframes: int | None) -> TruncatedBagError | None:
    """Every message in order, up to ``max_keyframes`` detection messages or the bag's damage, which is returned."""
    frames = 0
    try:
        for message in tqdm(reader.messages(), total=reader.num_messages, desc="bag", unit="message"):
            frames += converter.convert(message)
            if frames == max_keyframes:
                break
    except TruncatedBagError as damage:
        return damage
    return None


def describe(selection: Selection) -> str:
    """One line: which topic is what."""
    depth = selection.depth or "none: bearing only"
    pictures = f"image {selection.image}, depth {depth}" if selection.image else "no image: places alone"
    camera_info = f", camera_info {selection.camera_info}" if selection.camera_info else ""
    imu = f", imu {selection.imu}" if selection.imu else ""
    fixed = f", static transforms {selection.tf_static}" if selection.tf_static else ""
    return f"detections {selection.detections}, {pictures}{camera_info}, odometry {selection.odometry}{imu}{fixed}"


def summary(out: Path, converter: Converter, labels: LabelMap) -> list[str]:
    """What was written, and everything that was not, with numbers."""
    lines = [f"{out}: " + (_counts(converter.written) or "nothing written")]
    for title, counter in (
        ("detections dropped, label not listed in the label file", labels.unknown),
        ("detections dropped, label mapped to null", labels.unwanted),
        ("messages not usable", converter.dropped),
        (f"depth not used, {NEEDS_COLOUR} (record them, or boxes are bearings alone)", converter.idle_depths),
        ("messages of topics that are not needed", converter.ignored),
    ):
        if counter:
            lines.append(f"{title}: {_counts(counter)}")
    has_transforms = converter.written[topics.TF_STATIC] or converter.written[topics.TF]
    if not has_transforms and converter.written[absolute(topics.CAMERA_INFO)]:
        lines.append("no /tf_static: give the camera's pose in base_link as perception.extrinsics in the configuration")
    return [*lines, *converter.hints()]


def _counts(counter: Counter[str]) -> str:
    return ", ".join(f"{name or '(no label)'} {number}" for name, number in sorted(counter.items()))
