"""The messages of a folder's pictures: colour, depth, intrinsics, and where the camera looks in the level body."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.drive import Message
from semantic_slam.datasets.frames import BODY_FRAME, CAMERA_FRAME
from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.levelling import quaternion_of
from semantic_slam.datasets.scene_messages import camera_info
from semantic_slam.datasets.user_bag.image_formats import encoded_depth
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.typestore import message_class


def pictures_of(folder: ImageFolder, stamps_ns: list[int], rotations: Array) -> Iterator[Message]:
    """What the camera sends at each frame; ``rotations`` (F, 3, 3) are R_body_camera. Raises InputError."""
    for frame, stamp_ns, rotation in zip(folder.frames, stamps_ns, rotations, strict=True):
        yield stamp_ns, topics.TF, transform(stamp_ns, rotation)
        yield stamp_ns, topics.CAMERA_INFO, camera_info(folder.camera, 1.0, stamp_ns, CAMERA_FRAME)
        yield from picture(frame.colour, folder.depth_m(frame), stamp_ns)


def picture(colour: Path, depth_m: NDArray[np.float32] | None, stamp_ns: int) -> Iterator[Message]:
    """One picture with its depth, where there is any. Raises InputError."""
    yield stamp_ns, topics.IMAGE_COMPRESSED, _colour(colour, stamp_ns)
    if depth_m is not None:
        yield stamp_ns, topics.DEPTH_COMPRESSED, encoded_depth(depth_m, header_message(stamp_ns, CAMERA_FRAME))


def transform(stamp_ns: int, R_body_camera: Array) -> Any:
    """tf2_msgs/TFMessage from the level body to the camera's optical frame, which is at its origin."""
    x, y, z, w = (float(value) for value in quaternion_of(R_body_camera))
    moved = message_class("geometry_msgs/msg/Transform")(
        translation=message_class("geometry_msgs/msg/Vector3")(x=0.0, y=0.0, z=0.0),
        rotation=message_class("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w),
    )
    stamped = message_class("geometry_msgs/msg/TransformStamped")(
        header=header_message(stamp_ns, BODY_FRAME), child_frame_id=CAMERA_FRAME, transform=moved
    )
    return message_class("tf2_msgs/msg/TFMessage")(transforms=[stamped])


def _colour(path: Path, stamp_ns: int) -> Any:
    """The picture's own bytes."""
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}; restore it from the data set") from None
    text = "png" if path.suffix == ".png" else "jpeg"
    return message_class("sensor_msgs/msg/CompressedImage")(
        header=header_message(stamp_ns, CAMERA_FRAME), format=text, data=data
    )
