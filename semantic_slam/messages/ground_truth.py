"""Ground truth of simulated and annotated bags, and the progress of a replay."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.messages.layout import Layout, pack, unpack
from semantic_slam.messages.standard import header_message, header_stamp_ns
from semantic_slam.messages.typestore import message_class

OBJECTS_TYPE = "semantic_slam_msgs/msg/GroundTruthObjects"
ASSOCIATIONS_TYPE = "semantic_slam_msgs/msg/GroundTruthAssociations"
PROGRESS_TYPE = "semantic_slam_msgs/msg/ReplayProgress"

OBJECTS_LAYOUT: Layout = {"object_ids": ("O",), "class_names": ("O",), "poses": ("O", 7)}
ASSOCIATIONS_LAYOUT: Layout = {"object_id": ("D",)}
MOVING = "moving/"
"""Id prefix of true objects that move during the drive."""


@dataclass(frozen=True)
class GroundTruthObjects:
    """True objects of a scene, in the map frame; O objects. Moving objects have their first known pose."""

    stamp_ns: int
    object_ids: tuple[str, ...]  # (O,)
    class_names: tuple[str, ...]  # (O,)
    poses: NDArray[np.float64]  # (O, 7) x y z [m] qx qy qz qw

    @property
    def moves(self) -> NDArray[np.bool_]:
        """(O,) whether each moves during the drive."""
        return np.array([name.startswith(MOVING) for name in self.object_ids], dtype=np.bool_)


@dataclass(frozen=True)
class GroundTruthAssociations:
    """True object of every detection of the frame with this stamp; D detections."""

    stamp_ns: int
    object_ids: tuple[str, ...]  # (D,) "" for clutter


@dataclass(frozen=True)
class ReplayProgress:
    """Progress of a lossless replay."""

    stamp_ns: int  # of the newest frame counted
    frames: int  # sent by the player, or done with by the manager
    finished: bool


def objects_to_message(value: GroundTruthObjects) -> Any:
    header = header_message(value.stamp_ns, "map")
    return message_class(OBJECTS_TYPE)(header=header, **pack(OBJECTS_TYPE, OBJECTS_LAYOUT, vars(value)))


def objects_from_message(message: Any) -> GroundTruthObjects:
    return GroundTruthObjects(header_stamp_ns(message), **unpack(OBJECTS_TYPE, OBJECTS_LAYOUT, message))


def associations_to_message(value: GroundTruthAssociations) -> Any:
    arrays = pack(ASSOCIATIONS_TYPE, ASSOCIATIONS_LAYOUT, {"object_id": value.object_ids})
    return message_class(ASSOCIATIONS_TYPE)(header=header_message(value.stamp_ns, ""), **arrays)


def associations_from_message(message: Any) -> GroundTruthAssociations:
    return GroundTruthAssociations(header_stamp_ns(message), tuple(message.object_id))


def progress_to_message(value: ReplayProgress) -> Any:
    header = header_message(value.stamp_ns, "")
    return message_class(PROGRESS_TYPE)(header=header, frames=int(value.frames), finished=bool(value.finished))


def progress_from_message(message: Any) -> ReplayProgress:
    return ReplayProgress(header_stamp_ns(message), int(message.frames), bool(message.finished))
