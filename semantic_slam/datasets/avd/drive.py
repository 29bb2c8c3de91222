"""One drive through a scene, written into a bag stop by stop."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from semantic_slam.bag.writer import BagWriter
from semantic_slam.datasets.avd.objects import TrueObject, box_depth
from semantic_slam.datasets.avd.path import Stop
from semantic_slam.datasets.avd.scene import AvdScene
from semantic_slam.datasets.frames import BODY_FRAME, CAMERA_FRAME
from semantic_slam.datasets.planar_odometry import Odometry, OdometryNoise
from semantic_slam.datasets.scene_messages import camera_info, compressed_image, static_transform
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects
from semantic_slam.messages.standard import MAP_FRAME, OdometryEstimate, PoseEstimate
from semantic_slam.perception.frame import Detections

LABEL = "object"
FIRST_STAMP_NS = 1_000_000_000_000
STEP_NS = 500_000_000
INITIAL_SIGMA = np.array([10.0, 10.0, 0.2])
"""Standard deviations of the initial x, y [m] and yaw [rad]: a compass tells the heading, the position is unknown."""


@dataclass(frozen=True)
class ImportSettings:
    """What becomes of the images and boxes."""

    image_width: int | None = None  # pixels; None: as the data set has them
    max_difficulty: int = 2
    min_box_height_px: float = 50.0  # in the images of the data set
    max_depth_m: float = 4.5
    noise: OdometryNoise = field(default_factory=OdometryNoise)


class Drive:
    """Writes one drive, stop by stop, and counts its boxes."""

    def __init__(
        self, writer: BagWriter, scene: AvdScene, settings: ImportSettings, odometry: Odometry, truth: Array
    ) -> None:
        self._writer, self._scene, self._settings = writer, scene, settings
        self._odometry, self._truth = odometry, truth
        width = settings.image_width or scene.camera.width
        self._scale = width / scene.camera.width
        self.detections = 0
        self.skipped: Counter[str] = Counter()

    def write_start(self, objects: Sequence[TrueObject], initial: Array) -> None:
        """What is said once: extrinsics, where the robot believes to be, and the true objects."""
        height = float(np.median([image.T_map_camera[2, 3] for image in self._scene.images.values()]))
        self._put(topics.TF_STATIC, static_transform(FIRST_STAMP_NS, BODY_FRAME, CAMERA_FRAME, height), FIRST_STAMP_NS)
        spread = covariance_from_planar(np.diag(INITIAL_SIGMA**2))
        start = PoseEstimate(FIRST_STAMP_NS, MAP_FRAME, pose_vector_from_planar(initial), spread)
        self._put(topics.INITIAL_POSE, start, FIRST_STAMP_NS)
        if objects:
            ids = tuple(str(known.object_id) for known in objects)
            classes = tuple(known.class_name for known in objects)
            truth = GroundTruthObjects(FIRST_STAMP_NS, ids, classes, np.array([known.pose for known in objects]))
            self._put(topics.GROUND_TRUTH_OBJECTS, truth, FIRST_STAMP_NS)

    def write_stop(self, index: int, stop: Stop) -> None:
        """Odometry, and at a keyframe what the camera delivers."""
        stamp = FIRST_STAMP_NS + index * STEP_NS
        measured = pose_vector_from_planar(self._odometry.poses[index])
        spread = covariance_from_planar(self._odometry.covariances[index])
        self._put(topics.ODOMETRY, OdometryEstimate(stamp, "odom", BODY_FRAME, measured, spread), stamp)
        true_pose = pose_vector_from_planar(self._truth[index])
        truth = OdometryEstimate(stamp, MAP_FRAME, BODY_FRAME, true_pose, np.zeros((6, 6)))
        self._put(topics.GROUND_TRUTH_ODOMETRY, truth, stamp)
        if stop.keyframe:
            self._write_camera(stop.name, stamp)

    def _write_camera(self, name: str, stamp: int) -> None:
        colour, depth = self._scene.colour_path / name, self._scene.depth_path(name)
        self._put(topics.CAMERA_INFO, camera_info(self._scene.camera, self._scale, stamp, CAMERA_FRAME), stamp)
        image = compressed_image(colour, self._scale, stamp, CAMERA_FRAME, cv2.INTER_AREA)
        self._put(topics.IMAGE_COMPRESSED, image, stamp)
        if depth.is_file():
            picture = compressed_image(depth, self._scale, stamp, CAMERA_FRAME, cv2.INTER_NEAREST)
            self._put(topics.DEPTH_COMPRESSED, picture, stamp)
        boxes, ids = self._usable_boxes(name)
        none = ("",) * len(ids)
        labels = (LABEL,) * len(ids)
        seen = Detections(
            stamp_ns=stamp,
            frame_id=CAMERA_FRAME,
            boxes=boxes * self._scale,
            labels=labels,
            scores=np.ones(len(ids)),
            track_ids=none,
        )
        self._put(topics.DETECTIONS, seen, stamp)
        self._put(topics.GROUND_TRUTH_ASSOCIATIONS, GroundTruthAssociations(stamp, tuple(map(str, ids))), stamp)
        self.detections += len(ids)

    def _usable_boxes(self, name: str) -> tuple[Array, list[int]]:
        """(D, 4) boxes from left to right, an order that tells nothing about identities, and their instances."""
        image, settings = self._scene.images[name], self._settings
        depth = self._scene.depth_m(name) if self._scene.depth_path(name).is_file() else None
        kept = []
        for row in np.argsort(image.boxes[:, 0], kind="stable"):
            box = image.boxes[row]
            if image.difficulties[row] > settings.max_difficulty:
                self.skipped["too difficult"] += 1
            elif box[3] - box[1] < settings.min_box_height_px:
                self.skipped["too small"] += 1
            elif depth is not None and box_depth(depth, box) > settings.max_depth_m:
                self.skipped["too far"] += 1
            else:
                kept.append(int(row))
        return image.boxes[kept], image.instance_ids[kept].tolist()

    def _put(self, topic: str, message: Any, stamp: int) -> None:
        self._writer.write(topic, message, stamp)
