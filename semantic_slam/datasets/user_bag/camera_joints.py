"""The joints of /tf between a robot's body and a camera that static transforms do not connect with it."""

from contextlib import suppress
from typing import Any

from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.datasets.user_bag.topics import Selection
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import TransformTree, plain_frame


class CameraJoints:
    """What /tf says of the way from the body to one camera."""

    def __init__(self, base_frame: str, camera_frame: str, fixed: TransformTree) -> None:
        """``fixed`` holds the static transforms."""
        self._base, self._camera, self._fixed = base_frame, camera_frame, fixed
        self._all = fixed.copy()
        self.carry_camera = False  # by one joint, which a run can follow

    def add(self, message: Any) -> None:
        """The transforms of a tf2_msgs/TFMessage of /tf."""
        self._all.add(message)
        self.carry_camera |= any(
            self._fixed.connects(self._base, item.header.frame_id)
            and self._fixed.connects(item.child_frame_id, self._camera)
            for item in message.transforms
        )

    @property
    def fault(self) -> str:
        """Why a run cannot tell where the camera is, with the remedy; "" where it can, or no joint is between."""
        if self.carry_camera or not self._all.connects(self._base, self._camera):
            return ""
        return (
            f"several transforms of {topics.TF} lie between {self._base} and {self._camera}, and a run follows one:"
            f" publish {self._base} -> {plain_frame(self._camera)} on {topics.TF}"
        )


def read_camera_joints(
    reader: BagReader, selection: Selection, base_frame: str, fixed: TransformTree
) -> CameraJoints | None:
    """What /tf says of the camera of the images; None: it is fixed, or there are no images or no /tf."""
    if selection.image is None or selection.camera_info is None:
        return None
    moving = selection.moving_transforms
    if reader.topics.get(moving) != topics.TYPES[topics.TF]:
        return None
    with suppress(InputError):  # damage, or a message that does not decode: said when the bag is converted
        first = next(reader.messages([selection.camera_info.name]))
        camera_frame = str(reader.decode(first.cdr, first.type_name).header.frame_id)
        joints = CameraJoints(base_frame, camera_frame, fixed)
        return None if fixed.connects(base_frame, camera_frame) else _read(reader, moving, joints)
    return None


def _read(reader: BagReader, topic: str, joints: CameraJoints) -> CameraJoints:
    """Reads transforms that change until it is known which joint carries the camera."""
    with suppress(TruncatedBagError):  # said again when the bag is converted
        for message in reader.messages([topic]):
            with suppress(InputError):  # counted when the message is converted
                joints.add(reader.decode(message.cdr, message.type_name))
            if joints.carry_camera:
                break
    return joints
