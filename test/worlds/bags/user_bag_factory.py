"""Small bags as a user records them, with raw images, TF and types that are not installed; all poses are exact."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from semantic_slam_lab.simulation.detectors.detector_bag import DEFINITIONS as VISION_4

SECOND = 1_000_000_000
WIDTH, HEIGHT, FOCAL = 160, 120, 100.0

VISION_2 = {
    "Detection2DArray": VISION_4["Detection2DArray"],
    "Detection2D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox2D bbox\nbool is_tracking\nstring tracking_id",
    "ObjectHypothesisWithPose": "string id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose",
    "BoundingBox2D": "geometry_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
}
VISION_3D = {
    "Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
    "Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox3D bbox\nstring id",
    "ObjectHypothesisWithPose": VISION_4["ObjectHypothesisWithPose"],
    "ObjectHypothesis": VISION_4["ObjectHypothesis"],
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
}
YOLO = {
    "DetectionArray": "std_msgs/Header header\nyolo_msgs/Detection[] detections",
    "Detection": "int32 class_id\nstring class_name\nfloat64 score\nstring id\nyolo_msgs/BoundingBox2D bbox\n"
    "yolo_msgs/BoundingBox3D bbox3d\nyolo_msgs/Mask mask\nyolo_msgs/KeyPoint2DArray keypoints\n"
    "yolo_msgs/KeyPoint3DArray keypoints3d",
    "BoundingBox2D": "yolo_msgs/Pose2D center\nyolo_msgs/Vector2 size",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\nstring frame_id",
    "Pose2D": "yolo_msgs/Point2D position\nfloat64 theta",
    "Point2D": "float64 x\nfloat64 y",
    "Vector2": "float64 x\nfloat64 y",
    "Mask": "int32 height\nint32 width\nyolo_msgs/Point2D[] data",
    "KeyPoint2DArray": "yolo_msgs/KeyPoint2D[] data",
    "KeyPoint2D": "int32 id\nyolo_msgs/Point2D point\nfloat64 score",
    "KeyPoint3DArray": "yolo_msgs/KeyPoint3D[] data\nstring frame_id",
    "KeyPoint3D": "int32 id\ngeometry_msgs/Point point\nfloat64 score",
}
SEMANTIC_INFERENCE = {
    "FeatureImage": "std_msgs/Header header\nint32[] mask_ids\nsensor_msgs/Image image\n"
    "semantic_inference_msgs/FeatureVector[] features",
    "FeatureVector": "float32[] data",
}


DETECTORS = {
    "vision_4": ("vision_msgs", VISION_4),
    "vision_2": ("vision_msgs", VISION_2),
    "vision_3d": ("vision_msgs", VISION_3D),
    "yolo": ("yolo_msgs", YOLO),
    "segments": ("semantic_inference_msgs", SEMANTIC_INFERENCE),
}


@cache
def store_of(detector: str) -> Any:
    """Jazzy's types and those of the detector's package."""
    package, definitions = DETECTORS[detector]
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, text in definitions.items():
        types |= get_types_from_msg(text, f"{package}/msg/{name}")
    store.register(types)
    return store


@dataclass(frozen=True)
class Seen:
    """One detection as a detector reports it."""

    label: str
    u: float  # centre, pixels
    track_id: str = ""
    size: float = 24.0
    score: float = 0.9


class UserBag:
    """Writes messages of one store into a bag and remembers the connections."""

    def __init__(self, path: Path, detector: str = "vision_4") -> None:
        self.store = store_of(detector)
        self.writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self.connections: dict[str, Any] = {}

    def __enter__(self) -> "UserBag":
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.close()

    def make(self, type_name: str, **fields: Any) -> Any:
        return self.store.types[type_name](**fields)

    def write(self, topic: str, message: Any, stamp_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        self.writer.write(self.connections[topic], stamp_ns, self.store.serialize_cdr(message, kind))

    def header(self, stamp_ns: int, frame_id: str = "camera_optical_frame") -> Any:
        time = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // SECOND, nanosec=stamp_ns % SECOND)
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame_id)

    def pose(self, x: float = 0.0, y: float = 0.0, z: float = 0.0, rotation: tuple[float, ...] = (0, 0, 0, 1)) -> Any:
        position = self.make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))
        return self.make("geometry_msgs/msg/Pose", position=position, orientation=self.quaternion(rotation))

    def quaternion(self, rotation: tuple[float, ...]) -> Any:
        x, y, z, w = map(float, rotation)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def covariance_pose(self, pose: Any) -> Any:
        return self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36))

    def image(self, stamp_ns: int, pixels: np.ndarray, encoding: str) -> Any:
        """sensor_msgs/Image of (height, width[, channels]) pixels."""
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        return self.make(
            "sensor_msgs/msg/Image", header=self.header(stamp_ns), height=len(pixels), width=pixels.shape[1],
            encoding=encoding, is_bigendian=0, step=rows.shape[1], data=rows.ravel(),
        )  # fmt: skip

    def compressed(self, stamp_ns: int, pixels: np.ndarray, extension: str, text: str, prefix: bytes = b"") -> Any:
        data = prefix + cv2.imencode(extension, pixels)[1].tobytes()
        return self.make(
            "sensor_msgs/msg/CompressedImage", header=self.header(stamp_ns), format=text,
            data=np.frombuffer(data, dtype=np.uint8),
        )  # fmt: skip

    def camera_info(self, stamp_ns: int) -> Any:
        region = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        k = np.array([FOCAL, 0, WIDTH / 2, 0, FOCAL, HEIGHT / 2, 0, 0, 1.0])
        p = np.array([FOCAL, 0, WIDTH / 2, 0, 0, FOCAL, HEIGHT / 2, 0, 0, 0, 1.0, 0])
        return self.make(
            "sensor_msgs/msg/CameraInfo", header=self.header(stamp_ns), height=HEIGHT, width=WIDTH,
            distortion_model="plumb_bob", d=np.zeros(5), k=k, r=np.eye(3).ravel(), p=p, binning_x=0, binning_y=0,
            roi=region,
        )  # fmt: skip

    def odometry(self, stamp_ns: int, x: float) -> Any:
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        return self.make(
            "nav_msgs/msg/Odometry", header=self.header(stamp_ns, "odom"), child_frame_id="base_link",
            pose=self.covariance_pose(self.pose(x)),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )  # fmt: skip

    def transform(
        self,
        stamp_ns: int,
        parent: str,
        child: str,
        xyz: tuple[float, ...],
        rotation: tuple[float, ...] = (0, 0, 0, 1),
    ) -> Any:
        """tf2_msgs/TFMessage of one transform."""
        x, y, z = map(float, xyz)
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped", header=self.header(stamp_ns, parent), child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform", translation=self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
                rotation=self.quaternion(rotation),
            ),
        )  # fmt: skip
        return self.make("tf2_msgs/msg/TFMessage", transforms=[stamped])

    def camera_mount(self, parent: str = "base_link") -> Any:
        """/tf_static of a camera 0.1 m ahead of and 0.3 m above ``parent``, looking forward."""
        return self.transform(SECOND, parent, "camera_optical_frame", (0.1, 0, 0.3), (-0.5, 0.5, -0.5, 0.5))

    def vision_4(self, stamp_ns: int, seen: list[Seen]) -> Any:
        rows = []
        for item in seen:
            hypotheses = [("unlikely", item.score / 3), (item.label, item.score)]
            results = [
                self.make(
                    "vision_msgs/msg/ObjectHypothesisWithPose",
                    hypothesis=self.make("vision_msgs/msg/ObjectHypothesis", class_id=label, score=score),
                    pose=self.covariance_pose(self.pose()),
                )
                for label, score in hypotheses
            ]
            center = self.make(
                "vision_msgs/msg/Pose2D", position=self.make("vision_msgs/msg/Point2D", x=item.u, y=60.0), theta=0.0
            )
            box = self.make("vision_msgs/msg/BoundingBox2D", center=center, size_x=item.size, size_y=item.size)
            rows.append(
                self.make(
                    "vision_msgs/msg/Detection2D",
                    header=self.header(stamp_ns),
                    results=results,
                    bbox=box,
                    id=item.track_id,
                )
            )
        return self.make("vision_msgs/msg/Detection2DArray", header=self.header(stamp_ns), detections=rows)

    def vision_2(self, stamp_ns: int, seen: list[Seen]) -> Any:
        rows = [
            self.make(
                "vision_msgs/msg/Detection2D", header=self.header(stamp_ns),
                results=[
                    self.make(
                        "vision_msgs/msg/ObjectHypothesisWithPose", id=item.label, score=item.score,
                        pose=self.covariance_pose(self.pose()),
                    )
                ],
                bbox=self.make(
                    "vision_msgs/msg/BoundingBox2D",
                    center=self.make("geometry_msgs/msg/Pose2D", x=item.u, y=60.0, theta=0.0),
                    size_x=item.size, size_y=item.size,
                ),
                is_tracking=bool(item.track_id), tracking_id=item.track_id or "stale",
            )
            for item in seen
        ]  # fmt: skip
        return self.make("vision_msgs/msg/Detection2DArray", header=self.header(stamp_ns), detections=rows)

    def vision_3d(self, stamp_ns: int, seen: list[tuple[str, tuple[float, ...]]], sigma_m: float, frame: str) -> Any:
        """Labels with centres x y z in ``frame``, each with variance ``sigma_m`` squared along every axis."""
        rows = []
        for label, (x, y, z) in seen:
            pose = self.covariance_pose(self.pose(x, y, z))
            pose.covariance[[0, 7, 14]] = sigma_m**2
            hypothesis = self.make("vision_msgs/msg/ObjectHypothesis", class_id=label, score=0.8)
            result = self.make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=pose)
            size = self.make("geometry_msgs/msg/Vector3", x=1.0, y=1.0, z=1.0)
            box = self.make("vision_msgs/msg/BoundingBox3D", center=self.pose(x, y, z), size=size)
            header = self.header(stamp_ns, frame)
            rows.append(self.make("vision_msgs/msg/Detection3D", header=header, results=[result], bbox=box, id="t"))
        return self.make("vision_msgs/msg/Detection3DArray", header=self.header(stamp_ns, frame), detections=rows)

    def yolo(self, stamp_ns: int, seen: list[Seen]) -> Any:
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        rows = [
            self.make(
                "yolo_msgs/msg/Detection", class_id=7, class_name=item.label, score=item.score, id=item.track_id,
                bbox=self.make(
                    "yolo_msgs/msg/BoundingBox2D",
                    center=self.make(
                        "yolo_msgs/msg/Pose2D", position=self.make("yolo_msgs/msg/Point2D", x=item.u, y=60.0), theta=0.0
                    ),
                    size=self.make("yolo_msgs/msg/Vector2", x=item.size, y=item.size),
                ),
                bbox3d=self.make("yolo_msgs/msg/BoundingBox3D", center=self.pose(), size=zero, frame_id=""),
                mask=self.make("yolo_msgs/msg/Mask", height=0, width=0, data=[]),
                keypoints=self.make("yolo_msgs/msg/KeyPoint2DArray", data=[]),
                keypoints3d=self.make("yolo_msgs/msg/KeyPoint3DArray", data=[], frame_id=""),
            )
            for item in seen
        ]  # fmt: skip
        return self.make("yolo_msgs/msg/DetectionArray", header=self.header(stamp_ns), detections=rows)

    def segments(self, stamp_ns: int, seen: list[Seen], encoding: str = "16UC1", numbered: bool = True) -> Any:
        """Squares of pixels, the later in front, each with the vector (its number, 1, 0)."""
        kind = {"16UC1": np.uint16, "32SC1": np.int32}[encoding]
        numbers = np.zeros((HEIGHT, WIDTH), dtype=kind)
        for number, item in enumerate(seen, start=1):
            half, u = int(item.size) // 2, round(item.u)
            numbers[60 - half : 60 + half, max(u - half, 0) : u + half] = number
        return self.make(
            "semantic_inference_msgs/msg/FeatureImage", header=self.header(stamp_ns),
            mask_ids=np.arange(1, 1 + len(seen) * numbered, dtype=np.int32),
            image=self.image(stamp_ns, numbers, encoding),
            features=[
                self.make("semantic_inference_msgs/msg/FeatureVector", data=np.array([n, 1, 0], dtype=np.float32))
                for n in range(1, len(seen) + 1)
            ],
        )  # fmt: skip


def picture(seed: int) -> np.ndarray:
    """(HEIGHT, WIDTH, 3) smooth colours, so that JPEG keeps them."""
    coarse = np.random.default_rng(seed).integers(0, 255, (6, 8, 3), dtype=np.uint8)
    return cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)


def write_drive(path: Path, *, detector: str = "vision_4", frames: int = 6, depth: str = "16UC1", **more: Any) -> Path:
    """A robot that drives 0.1 m per frame towards two objects; ``depth`` is an encoding, or "" for none.

    ``joints``: (parent, child) frames between the body and the camera whose transforms are on /tf at every frame.
    """
    ids, joints = more.get("track_ids", ("a", "b")), more.get("joints", ())
    with UserBag(path, detector) as bag:
        if joints:
            bag.write("/tf_static", bag.camera_mount(joints[-1][1]), SECOND)
        elif more.get("static", True):
            bag.write("/tf_static", bag.camera_mount(), SECOND)
        for index in range(frames):
            stamp = SECOND + index * SECOND // 5
            distance = 3.0 - 0.1 * index
            seen = [
                Seen("cup", 80 + FOCAL * 0.5 / distance, ids[0]),
                Seen("bottle", 80 - FOCAL * 0.6 / distance, ids[1]),
            ]
            bag.write("/odometry/filtered", bag.odometry(stamp, 0.1 * index), stamp)
            for parent, child in joints:
                bag.write("/tf", bag.transform(stamp, parent, child, (0, 0, 0)), stamp)
            bag.write("/camera/color/camera_info", bag.camera_info(stamp), stamp)
            bag.write("/camera/color/image_raw", bag.image(stamp, picture(index), "rgb8"), stamp)
            if depth:
                _write_depth(bag, stamp, depth, distance)
            bag.write("/detector/boxes", getattr(bag, detector)(stamp, seen), stamp)
    return path


def _write_depth(bag: UserBag, stamp: int, kind: str, distance: float) -> None:
    metres = np.full((HEIGHT, WIDTH), distance, dtype=np.float32)
    metres[0, 0] = np.nan
    millimetres = np.nan_to_num(metres * 1000.0).astype(np.uint16)
    topic = "/camera/aligned_depth/image_raw"
    if kind == "32FC1":
        bag.write(topic, bag.image(stamp, metres, kind), stamp)
    elif kind == "16UC1":
        bag.write(topic, bag.image(stamp, millimetres, kind), stamp)
    else:
        text = "16UC1; compressedDepth png"
        bag.write(f"{topic}/compressedDepth", bag.compressed(stamp, millimetres, ".png", text, bytes(12)), stamp)
