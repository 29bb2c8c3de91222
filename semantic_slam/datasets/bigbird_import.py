"""``import_dataset bigbird``: one camera's views of an object on a turntable, as the drive of a robot around it.

The table stands still and the camera orbits: map is the table's frame, with the object at its origin. base_link lies
at the table's height below the camera and looks where the camera looks. Odometry is the true motion, exact.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from semantic_slam.bag.writer import BagWriter
from semantic_slam.datasets.bigbird import CAMERAS, TurntableView, object_folders, read_calibration, turntable_views
from semantic_slam.datasets.frames import BODY_FRAME, CAMERA_FRAME
from semantic_slam.datasets.scene_messages import camera_info, compressed_image
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.geometry.transform import between, compose, inverse
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects
from semantic_slam.messages.standard import MAP_FRAME, NANOSECONDS, OdometryEstimate, PoseEstimate, header_message
from semantic_slam.messages.typestore import message_class
from semantic_slam.perception.frame import CameraModel, Detections

FIRST_STAMP_NS = 1000 * NANOSECONDS
STEP_NS = NANOSECONDS // 2
OBJECT_ID = "1"
LABEL = "object"


@dataclass(frozen=True)
class Imported:
    """What the bag holds."""

    object_name: str
    views: int
    wobble_m: float  # how far the camera strays from its place on base_link, at most


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset bigbird``."""
    parser.add_argument("source", type=Path, metavar="SRC", help="folder of one object")
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    parser.add_argument("--camera", choices=CAMERAS, default=CAMERAS[0], help="which ring (default: NP1, the lowest)")
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N views")


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Import and say what the bag holds; raises InputError."""
    result = import_bigbird(arguments.source, bag, arguments.camera, arguments.max_keyframes)
    print(
        f"{arguments.out}: {result.views} views of {result.object_name} from {arguments.camera}, boxes from masks;"
        f" the camera strays up to {1000 * result.wobble_m:.1f} mm from its place on {BODY_FRAME}"
    )


def import_bigbird(source: Path, bag: Path, camera: str = CAMERAS[0], max_keyframes: int | None = None) -> Imported:
    """Write the views of one camera in the order of the table's angle."""
    folders = object_folders(source)
    if len(folders) > 1:
        raise InputError(f"{source}: holds {len(folders)} objects; name the folder of one, such as {folders[0]}")
    views = sorted(turntable_views(folders[0], (camera,)), key=lambda view: view.angle_deg)[:max_keyframes]
    intrinsics = intrinsics_of(views[0])
    first = camera_pose(views[0])
    T_base_camera = between(below(first), first)
    wobble_m = 0.0
    with BagWriter(bag) as writer:
        write_start(writer, T_base_camera, views[0])
        for index, view in enumerate(tqdm(views, desc=view_name(views[0]), unit="view")):
            pose = camera_pose(view)
            wobble_m = max(wobble_m, float(np.linalg.norm(between(below(pose), pose)[:3] - T_base_camera[:3])))
            T_map_base = compose(pose, inverse(T_base_camera))
            write_view(writer, view, intrinsics, T_map_base, FIRST_STAMP_NS + index * STEP_NS)
    return Imported(views[0].object_name, len(views), wobble_m)


def view_name(view: TurntableView) -> str:
    return f"{view.object_name} {view.camera}"


def intrinsics_of(view: TurntableView) -> CameraModel:
    """The colour camera's model from calibration.h5 and the size of its pictures."""
    calibration = read_calibration(view.folder)
    matrix, distortion = calibration.rgb_matrices[view.camera], calibration.rgb_distortions[view.camera]
    height, width = view.image.shape[:2]
    fx, fy, cx, cy = (float(matrix[index]) for index in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return CameraModel(width, height, fx, fy, cx, cy, tuple(float(value) for value in distortion), CAMERA_FRAME)


def camera_pose(view: TurntableView) -> Array:
    """(7,) T_map_camera of a turntable view, in the camera's optical frame."""
    matrix = view.table_from_camera
    return np.concatenate([matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]).as_quat()])


def below(T_map_camera: Array) -> Array:
    """(7,) T_map_base: on the ground below the camera, x along its viewing direction."""
    direction = Rotation.from_quat(T_map_camera[3:]).as_matrix()[:, 2]
    yaw = np.arctan2(direction[1], direction[0])
    return pose_vector_from_planar(np.array([T_map_camera[0], T_map_camera[1], yaw]))


def write_start(writer: BagWriter, T_base_camera: Array, view: TurntableView) -> None:
    """What is said once: extrinsics, the start, the object."""
    writer.write(topics.TF_STATIC, static_transform(T_base_camera), FIRST_STAMP_NS)
    start = PoseEstimate(FIRST_STAMP_NS, MAP_FRAME, below(camera_pose(view)), np.diag([1e-4, 1e-4, 0, 0, 0, 1e-4]))
    writer.write(topics.INITIAL_POSE, start, FIRST_STAMP_NS)
    at_origin = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    truth = GroundTruthObjects(FIRST_STAMP_NS, (OBJECT_ID,), (view.object_name,), at_origin)
    writer.write(topics.GROUND_TRUTH_OBJECTS, truth, FIRST_STAMP_NS)


def write_view(writer: BagWriter, view: TurntableView, camera: CameraModel, T_map_base: Array, stamp_ns: int) -> None:
    """One picture with its box; T_map_base composed with the extrinsics is the exact camera pose about the object."""
    for topic, frame in ((topics.ODOMETRY, "odom"), (topics.GROUND_TRUTH_ODOMETRY, MAP_FRAME)):
        writer.write(topic, OdometryEstimate(stamp_ns, frame, BODY_FRAME, T_map_base, np.zeros((6, 6))), stamp_ns)
    writer.write(topics.CAMERA_INFO, camera_info(camera, 1.0, stamp_ns, CAMERA_FRAME), stamp_ns)
    path = view.folder / f"{view.stem}.jpg"
    writer.write(topics.IMAGE_COMPRESSED, compressed_image(path, 1.0, stamp_ns, CAMERA_FRAME, cv2.INTER_AREA), stamp_ns)
    box = view.box.reshape(1, 4)
    writer.write(
        topics.DETECTIONS,
        Detections(
            stamp_ns=stamp_ns, frame_id=CAMERA_FRAME, boxes=box, labels=(LABEL,), scores=np.ones(1), track_ids=("",)
        ),
        stamp_ns,
    )
    writer.write(topics.GROUND_TRUTH_ASSOCIATIONS, GroundTruthAssociations(stamp_ns, (OBJECT_ID,)), stamp_ns)


def static_transform(T_base_camera: Array) -> Any:
    """tf2_msgs/TFMessage base_link -> camera_optical_frame."""
    x, y, z, qx, qy, qz, qw = (float(value) for value in T_base_camera)
    transform = message_class("geometry_msgs/msg/Transform")(
        translation=message_class("geometry_msgs/msg/Vector3")(x=x, y=y, z=z),
        rotation=message_class("geometry_msgs/msg/Quaternion")(x=qx, y=qy, z=qz, w=qw),
    )
    stamped = message_class("geometry_msgs/msg/TransformStamped")(
        header=header_message(FIRST_STAMP_NS, BODY_FRAME), child_frame_id=CAMERA_FRAME, transform=transform
    )
    return message_class("tf2_msgs/msg/TFMessage")(transforms=[stamped])
