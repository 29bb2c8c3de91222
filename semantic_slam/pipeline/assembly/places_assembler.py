"""Turns detections without images into measurements, in whatever order they and camera_info arrive.

The result depends on the messages' stamps alone. Detections with positions are measured at once; boxes wait for the
camera's intrinsics: in space all of them that have no position, in the plane those of frames without any position.
Positions without boxes may be in any frame that static transforms connect with the body.
"""

from collections import Counter
from collections.abc import Callable
from typing import Self

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import TransformTree, plain_frame
from semantic_slam.perception.frame import CameraModel, Detections
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.places import PlaceReader
from semantic_slam.pipeline.assembly.body_places import have_boxes, have_places, with_places_in_body
from semantic_slam.pipeline.assembly.detections_input import DetectionsInput
from semantic_slam.reasons import count, quoted


class PlacesAssembler(DetectionsInput):
    """Turns detections into measurements, in stamp order; ``dropped`` counts unused ones by reason."""

    def __init__(
        self,
        configuration: Configuration,
        camera_pose: Callable[[str], Array],
        transforms: TransformTree | None = None,
    ) -> None:
        """``camera_pose`` returns the (7,) pose of a camera's frame in the body frame, or raises InputError.

        ``transforms``: those of /tf_static, which may grow, and by which positions are moved to the body frame.
        """
        super().__init__(rectified=configuration.perception.rectified)
        self._reader = PlaceReader(configuration.perception, in_space=configuration.is_spatial)
        self._in_space = configuration.is_spatial
        self._has_region_of_camera = self._in_space and configuration.open_world.region_by_camera
        self._base_frame = configuration.perception.base_frame
        self._camera_pose = camera_pose
        self._transforms = TransformTree() if transforms is None else transforms
        self._num_measured = 0

    @property
    def dropped(self) -> Counter[str]:
        return self._lost + self._reader.dropped

    @property
    def num_waiting(self) -> int:
        """Number of detections that wait for the camera, without any whose suspicious stamp is on hold."""
        return len(self._detections)

    @property
    def num_without_camera(self) -> int:
        """Number of detections that wait since no camera is known."""
        return len(self._detections) if self.camera is None else 0

    @property
    def is_over(self) -> bool:
        """Whether the stamps of detections went back, so that another session has started."""
        return self._detections.is_set_back

    def go_on_from(self, former: Self) -> None:
        """Take the detections of this session that the assembler of the previous one has refused."""
        super().go_on_from(former)
        self._num_measured = former._num_measured  # sequence numbers continue

    def take(self) -> list[SemanticMeasurements]:
        """Measurements that are complete, in stamp order."""
        return self._measurements(at_end=False)

    def flush(self) -> list[SemanticMeasurements]:
        """All remaining measurements, once no more messages will come."""
        self._detections.release()
        return self._measurements(at_end=True)

    def _measurements(self, at_end: bool) -> list[SemanticMeasurements]:
        made = []
        while len(self._detections):
            detections = self._detections.first()[1]
            if self._needs_camera(detections) and self.camera is None and not at_end:
                break
            try:
                detections = with_places_in_body(self._detections.pop(), self._base_frame, self._transforms)
            except InputError as fault:  # a frame without them would count as misses
                count(self._lost, str(fault))
                continue
            made.append(self._measure(detections))
            self._num_measured += 1
        return made

    def _measure(self, detections: Detections) -> SemanticMeasurements:
        looks = self._needs_camera(detections) or (self._in_space and not len(detections))  # misses count in its view
        camera = self.camera if looks else None
        if camera is None:
            return self._reader.measure(detections, self._num_measured)
        try:
            T_base_camera = camera.optical_pose(self._camera_pose(camera.frame_id))
            if plain_frame(detections.frame_id) not in self._frames_of_boxes(detections, camera):
                own, expected = quoted(detections.frame_id), quoted(camera.frame_id)
                raise InputError(f"frame id {own} is not the camera's {expected}")
        except InputError as fault:  # in a live system the transform may still arrive
            count(self._lost, f"{topics.DETECTIONS}: boxes without their camera: {fault}")
            return self._reader.measure(detections, self._num_measured)
        return self._reader.measure(detections, self._num_measured, camera, T_base_camera)

    def _needs_camera(self, detections: Detections) -> bool:
        """Whether detections have boxes that count and have no place but by the camera, or it is where misses count."""
        if self._has_region_of_camera:
            return True
        are_told = have_places(detections)
        if are_told.any() and not self._in_space:
            return False
        return bool((have_boxes(detections) & ~are_told).any())

    def _frames_of_boxes(self, detections: Detections, camera: CameraModel) -> set[str]:
        """Frame ids that boxes of the camera may have; beside positions also the body's, which is that of positions."""
        frames = {plain_frame(camera.frame_id)}
        return frames | {plain_frame(self._base_frame)} if have_places(detections).any() else frames
