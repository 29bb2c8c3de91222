"""Pipeline front end without a network: keyframes and drops of the first frames."""

from collections import Counter
from dataclasses import replace
from functools import partial
from typing import Any

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.sensor import sensor_pose
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.range_bearing import range_and_bearing
from semantic_slam.pipeline.assembly.frame_assembler import FrameAssembler
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.gravity.gravity_by_imu import ImuSource
from semantic_slam.pipeline.input_topics import InputTopics
from semantic_slam.pipeline.preamble import Preamble

MOST_FRAMES = {True: 100, False: 600}
"""Number of detection messages examined, with images (True) and without (False)."""


class FrontEnd:
    """Processes the messages of an input until enough frames were seen."""

    def __init__(self, configuration: Configuration, found: InputTopics, preamble: Preamble) -> None:
        settings = configuration.perception
        everywhere = replace(
            configuration.open_world, learn_region=True, learn_region_within_m=0.0
        )  # what lies outside is looked at
        configuration = replace(configuration, open_world=everywhere)
        self.keyframes: list[Keyframe] = []
        self.camera_poses: list[Array] = []  # (7,) T_base_camera of each frame
        self.faults: list[str] = []
        self.num_frames = 0
        self._settings, self._found, self._preamble = settings, found, preamble
        fixed = preamble.transforms if found.transforms else None
        self._frames = FrameAssembler(configuration, has_depth=bool(found.depth), fixed_transforms=fixed)
        self._places = PlacesAssembler(configuration, self._camera_pose, preamble.transforms)
        self._assembler = KeyframeAssembler(
            configuration,
            has_identities=bool(found.identities),
            imu=ImuSource(preamble.transforms) if found.imu else None,
        )
        sensor = partial(range_and_bearing, configuration=settings)
        space = configuration.is_spatial
        self._measurer = Classifier(None, settings, seed=0, range_bearing_sensor=sensor, in_space=space)
        self._wants_identities = strategy_of(configuration).wants_identities

    @property
    def camera(self) -> CameraModel | None:
        return self._frames.camera or self._places.camera

    @property
    def is_done(self) -> bool:
        return self.num_frames >= MOST_FRAMES[self._found.has_images]

    @property
    def dropped(self) -> Counter[str]:
        parts = self._frames, self._places, self._measurer, self._assembler
        return sum((part.dropped for part in parts), Counter[str]())

    def take(self, topic: str, message: Any) -> None:
        """One message; what cannot be used is a fault once."""
        found = self._found
        try:
            if topic == found.odometry:
                self._assembler.add_odometry(message)
            elif topic == found.imu:
                self._assembler.add_imu(message)
            elif topic == found.camera_info:
                (self._frames if found.has_images else self._places).add_camera_info(message)
            elif topic == found.image:
                self._frames.add_image(message)
            elif topic == found.depth:
                self._frames.add_depth(message)
            elif topic == found.transforms:
                self._frames.add_transforms(message)
            elif topic == found.identities and self._wants_identities:
                self._assembler.add_identities(from_message(message))
            elif topic == (found.measurements or found.detections):
                self._add_detections(message)
            self._work(at_end=False)
        except InputError as fault:
            self._note(fault)

    def finish(self) -> None:
        """Use what still waits for later messages."""
        try:
            self._work(at_end=True)
        except InputError as fault:
            self._note(fault)

    def _note(self, fault: InputError) -> None:
        if str(fault) not in self.faults:
            self.faults.append(str(fault))

    def _add_detections(self, message: Any) -> None:
        self.num_frames += 1
        if self._found.measurements:
            self._assembler.add_measurements(from_message(message))
        else:
            (self._frames if self._found.has_images else self._places).add_detections(message)

    def _work(self, *, at_end: bool) -> None:
        for frame in self._frames.flush() if at_end else self._frames.take():
            T_base_camera = frame.T_base_camera
            if T_base_camera is None:
                T_base_camera = self._camera_pose(frame.camera.frame_id)
            self._measured(self._measurer.measure(frame, len(self.camera_poses), T_base_camera))
            self.camera_poses.append(T_base_camera)
        for measurements in self._places.flush() if at_end else self._places.take():
            self._measured(measurements)
        self.keyframes += self._assembler.flush() if at_end else self._assembler.take()

    def _measured(self, measurements: SemanticMeasurements) -> None:
        self._assembler.add_measurements(measurements)

    def _camera_pose(self, optical_frame: str) -> Array:
        settings = self._settings
        return sensor_pose(settings.extrinsics, settings.base_frame, self._preamble.transforms, optical_frame)
