"""Registry of message types, ours included: equal CDR bytes are sent over DDS and stored in bags.

Nodes publish and receive serialised messages, so that bags and DDS share one encoder, without rclpy's field
conversion.
"""

from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from semantic_slam.errors import MessageError

PACKAGE = "semantic_slam_msgs"
DEFINITIONS = Path(__file__).parent / "definitions"
"""Folder of our ``*.msg`` files; in a checkout this is msg_defs/msg/, which colcon builds."""


@cache
def typestore() -> Typestore:
    """Types of ROS 2 Jazzy and of ``semantic_slam_msgs``."""
    store = get_typestore(Stores.ROS2_JAZZY)
    definitions: dict[str, Any] = {}
    for path in sorted(DEFINITIONS.glob("*.msg")):
        definitions |= get_types_from_msg(path.read_text(encoding="utf-8"), f"{PACKAGE}/msg/{path.stem}")
    store.register(definitions)
    return store


def message_class(type_name: str) -> Any:
    """The dataclass of a message type, e.g. ``semantic_slam_msgs/msg/HybridBelief``."""
    return typestore().types[type_name]


def serialize(message: Any) -> bytes:
    """CDR bytes (little endian) of a message built from :func:`message_class`."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


HEADER = 4
"""Size in bytes of the CDR encapsulation header."""
MOST_BEHIND = 128
"""Largest number of trailing bytes accepted after a message; rclpy's ``serialize_message`` pads to its buffer size."""


def deserialize(data: bytes, type_name: str) -> Any:
    """Message from its CDR bytes; raises MessageError."""
    try:
        return _deserialized(data, type_name)
    except Exception as fault:  # any decoder error means that the bytes are invalid
        reason = " ".join(f"{type(fault).__name__} {fault}".split())[:100]
        raise MessageError(
            f"{type_name}: {len(data)} bytes do not decode ({reason}); was another definition used?",
            "message does not decode",
        ) from None


def _deserialized(data: bytes, type_name: str) -> Any:
    if len(data) < HEADER or bytes(data[:2]) not in (b"\x00\x00", b"\x00\x01"):
        raise ValueError("no plain CDR")
    store = typestore()
    definition = store.get_msgdef(type_name)
    read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
    message, end = read(data[HEADER:], 0, definition.cls, store)
    if len(data) - HEADER - end > MOST_BEHIND:
        raise ValueError(f"the message ends after {HEADER + end}")
    return message
