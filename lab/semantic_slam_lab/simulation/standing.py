"""``make_scene --standing``: the bag of a robot that stands still before furniture which looks like another class.

Nothing moves, so every picture repeats what misleads in this view; only the sensors' noise is new in each.
"""

import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from semantic_slam.bag.writer import BagWriter
from semantic_slam.datasets.avd.drive import FIRST_STAMP_NS, LABEL, STEP_NS
from semantic_slam.datasets.avd.objects import surveyed_map
from semantic_slam.datasets.frames import BODY_FRAME, CAMERA_FRAME
from semantic_slam.datasets.scene_messages import camera_info, encoded_image, static_transform
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects
from semantic_slam.messages.standard import OdometryEstimate, PoseEstimate
from semantic_slam.perception.frame import CameraModel, Detections
from semantic_slam_lab.simulation.annotation import Annotation, annotate
from semantic_slam_lab.simulation.detectors.sensor_noise import SensorNoise, noisy_boxes, noisy_depth_m, noisy_image
from semantic_slam_lab.simulation.layout import draw_layout, room
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, scene_xml
from semantic_slam_lab.simulation.renderer import Renderer, Rendering, camera_model
from semantic_slam_lab.simulation.scene import level_cameras
from semantic_slam_lab.simulation.tour import CAMERA_HEIGHT_M, HORIZONTAL_FOV_RAD

NAME = "standing"
ROOM_SEED = 0
"""The room of the shipped bag."""
WATCHED = "desk_1"
AZIMUTH_RAD, DISTANCE_M = float(np.deg2rad(99.0)), 2.1
"""Where the robot stands, in the frame of the object that it watches: the desk's planked side is a crate's, too."""
INITIAL_SIGMA = np.array([0.02, 0.02, 0.01])
"""Standard deviations of the initial x, y [m] and yaw [rad]: the robot knows where it stands."""
OBJECT_SIGMA = np.array([0.03, 0.03, 0.01])
"""Standard deviations of x, y [m] and yaw [rad] of the objects in the map prior, which knows no classes."""
JPEG_QUALITY = 85
PURPOSES = {"initial_pose": 21, "map_prior": 22, "sensors": 23}
"""Keys that make the random draws of one seed independent."""


@dataclass(frozen=True)
class StandingSettings:
    """Length of the recording, size of the pictures, and how far the detector sees."""

    num_frames: int = 50
    width: int = 400
    height: int = 300
    max_range_m: float = 3.0
    max_difficulty: int = 2
    noise: SensorNoise = field(default_factory=SensorNoise)


def write_standing(folder: Path, seed: int, settings: StandingSettings | None = None) -> Path:
    """Write ``folder/standing.mcap`` and its map prior ``folder/standing.objects.json``; returns the bag.

    ``seed`` is that of all noise. Raises InputError where ``folder`` cannot be written.
    """
    settings = settings or StandingSettings()
    objects = draw_layout(ROOM_SEED)
    truth = standing_place(objects)
    camera = camera_model(settings.width, settings.height, HORIZONTAL_FOV_RAD)
    T_map_camera = level_cameras(truth[None, :2], truth[2:])[0]
    with Renderer(*scene_xml(objects, room()), camera) as renderer:
        view = renderer.render(T_map_camera)
    seen = detectable(annotate(view.body_ids, objects, T_map_camera, camera), objects, truth, settings)
    bag = folder / f"{NAME}.mcap"
    with tempfile.TemporaryDirectory() as scratch:
        with BagWriter(Path(scratch) / NAME) as writer:
            Recording(writer, camera, settings, truth, np.random.default_rng([seed, PURPOSES["sensors"]])).write(
                view, seen, objects, _drawn(truth, INITIAL_SIGMA, seed, "initial_pose")
            )
        _put_files(bag, next((Path(scratch) / NAME).glob("*.mcap")).read_bytes(), uncertain_map(objects, seed))
    return bag


def standing_place(objects: tuple[PlacedObject, ...]) -> Array:
    """(3,) pose of base_link in map: some steps from the watched object, facing it."""
    watched = next(placed for placed in objects if placed.name == WATCHED)
    direction = watched.yaw_rad + AZIMUTH_RAD
    x, y = watched.x_m + DISTANCE_M * np.cos(direction), watched.y_m + DISTANCE_M * np.sin(direction)
    return np.array([x, y, np.arctan2(watched.y_m - y, watched.x_m - x)])


def detectable(
    annotations: list[Annotation], objects: tuple[PlacedObject, ...], truth: Array, settings: StandingSettings
) -> list[Annotation]:
    """What the detector finds, from left to right: near enough and hardly hidden."""
    places = {placed.object_id: np.array([placed.x_m, placed.y_m]) for placed in objects}
    near = [
        found
        for found in annotations
        if found.difficulty <= settings.max_difficulty
        and np.linalg.norm(places[found.object_id] - truth[:2]) <= settings.max_range_m
    ]
    return sorted(near, key=lambda found: found.box[0])


def uncertain_map(objects: tuple[PlacedObject, ...], seed: int) -> MapPrior:
    """A surveyed map: poses drawn about the truth, no classes."""
    rng = np.random.default_rng([seed, PURPOSES["map_prior"]])
    return surveyed_map({placed.object_id: placed.pose for placed in objects}, OBJECT_SIGMA, rng)


@dataclass(frozen=True)
class Recording:
    """Writes what the robot records while it stands."""

    writer: BagWriter
    camera: CameraModel
    settings: StandingSettings
    truth: Array  # (3,) T_map_base
    rng: np.random.Generator

    def write(self, view: Rendering, seen: list[Annotation], objects: tuple[PlacedObject, ...], initial: Array) -> None:
        """All frames of one view; ``initial`` (3,) is where the robot believes to stand."""
        self._write_start(objects, initial)
        for index in tqdm(range(self.settings.num_frames), desc=NAME, unit="frame"):
            self._write_frame(view, seen, FIRST_STAMP_NS + index * STEP_NS)

    def _write_start(self, objects: tuple[PlacedObject, ...], initial: Array) -> None:
        extrinsics = static_transform(FIRST_STAMP_NS, BODY_FRAME, CAMERA_FRAME, CAMERA_HEIGHT_M)
        self._put(topics.TF_STATIC, extrinsics, FIRST_STAMP_NS)
        spread = covariance_from_planar(np.diag(INITIAL_SIGMA**2))
        start = PoseEstimate(FIRST_STAMP_NS, "map", pose_vector_from_planar(initial), spread)
        self._put(topics.INITIAL_POSE, start, FIRST_STAMP_NS)
        ids = tuple(str(placed.object_id) for placed in objects)
        classes = tuple(placed.class_name for placed in objects)
        truth = GroundTruthObjects(FIRST_STAMP_NS, ids, classes, np.array([placed.pose for placed in objects]))
        self._put(topics.GROUND_TRUTH_OBJECTS, truth, FIRST_STAMP_NS)

    def _write_frame(self, view: Rendering, seen: list[Annotation], stamp: int) -> None:
        """Odometry that says "nothing moved", and one set of noisy pictures and boxes."""
        still, none = pose_vector_from_planar(np.zeros(3)), np.zeros((6, 6))
        self._put(topics.ODOMETRY, OdometryEstimate(stamp, "odom", BODY_FRAME, still, none), stamp)
        pose = pose_vector_from_planar(self.truth)
        self._put(topics.GROUND_TRUTH_ODOMETRY, OdometryEstimate(stamp, "map", BODY_FRAME, pose, none), stamp)
        self._put(topics.CAMERA_INFO, camera_info(self.camera, 1.0, stamp, CAMERA_FRAME), stamp)
        noise = self.settings.noise
        colours = cv2.cvtColor(noisy_image(view.image, noise, self.rng), cv2.COLOR_RGB2BGR)
        jpeg = bytes(cv2.imencode(".jpg", colours, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1])
        self._put(topics.IMAGE_COMPRESSED, encoded_image(jpeg, ".jpg", stamp, CAMERA_FRAME), stamp)
        millimetres = np.nan_to_num(np.round(noisy_depth_m(view.depth_m, noise, self.rng) * 1000.0), nan=0.0)
        png = bytes(cv2.imencode(".png", millimetres.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 9])[1])
        self._put(topics.DEPTH_COMPRESSED, encoded_image(png, ".png", stamp, CAMERA_FRAME), stamp)
        boxes = noisy_boxes(np.array([found.box for found in seen], dtype=np.float64), noise, self.rng)
        blank = ("",) * len(seen)
        found = Detections(
            stamp_ns=stamp,
            frame_id=CAMERA_FRAME,
            boxes=boxes,
            labels=(LABEL,) * len(seen),
            scores=np.ones(len(seen)),
            track_ids=blank,
        )
        self._put(topics.DETECTIONS, found, stamp)
        ids = tuple(str(found.object_id) for found in seen)
        self._put(topics.GROUND_TRUTH_ASSOCIATIONS, GroundTruthAssociations(stamp, ids), stamp)

    def _put(self, topic: str, message: Any, stamp: int) -> None:
        self.writer.write(topic, message, stamp)


def _drawn(truth: Array, sigma: Array, seed: int, purpose: str) -> Array:
    """(3,) drawn about the truth, as far off as ``sigma`` (3,) says."""
    return np.asarray(truth + sigma * np.random.default_rng([seed, PURPOSES[purpose]]).standard_normal(3))


def _put_files(bag: Path, content: bytes, prior: MapPrior) -> None:
    try:
        bag.parent.mkdir(parents=True, exist_ok=True)
        bag.write_bytes(content)
        bag.with_suffix(".objects.json").write_text(prior.to_json() + "\n", encoding="utf-8")
    except OSError as fault:
        raise InputError(f"{bag}: cannot be written ({fault.strerror}); name another --out") from None
