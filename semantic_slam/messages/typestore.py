"""One registry of message types, ours included: the same CDR bytes travel over DDS and lie in bags.

Nodes publish and receive serialised messages, so that a bag and the wire share one encoder and no
rclpy field conversion stands between them.
"""

from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from semantic_slam.errors import SemanticSlamError

PACKAGE = "semantic_slam_msgs"


def definitions_folder() -> Path:
    """Folder of our ``*.msg`` files: in the source tree, or installed beside this module."""
    for folder in (Path(__file__).parents[2] / "msg_defs" / "msg", Path(__file__).parent / "definitions"):
        if folder.is_dir():
            return folder
    raise SemanticSlamError("message definitions are missing; install semantic_slam again (make setup)")


@cache
def typestore() -> Typestore:
    """Types of ROS 2 Jazzy and of ``semantic_slam_msgs``."""
    store = get_typestore(Stores.ROS2_JAZZY)
    definitions: dict[str, Any] = {}
    for path in sorted(definitions_folder().glob("*.msg")):
        definitions |= get_types_from_msg(path.read_text(encoding="utf-8"), f"{PACKAGE}/msg/{path.stem}")
    store.register(definitions)
    return store


def message_class(type_name: str) -> Any:
    """The dataclass of a message type, e.g. ``semantic_slam_msgs/msg/HybridBelief``."""
    return typestore().types[type_name]


def serialize(message: Any) -> bytes:
    """CDR bytes (little endian) of a message built from :func:`message_class`."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


def deserialize(data: bytes, type_name: str) -> Any:
    """Message from its CDR bytes."""
    return typestore().deserialize_cdr(data, type_name)
