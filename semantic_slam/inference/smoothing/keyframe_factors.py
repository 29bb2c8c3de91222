"""The factors of one keyframe that its hypotheses share: GTSAM never changes them."""

from functools import cached_property
from typing import Any

from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.odometry_bias import biased_factor
from semantic_slam.inference.models.step import AssociatedDetection, Motion
from semantic_slam.inference.states.keys import bias_key, object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces


class KeyframeFactors:
    """Odometry to a keyframe, and geometry of its detections; each is made once."""

    def __init__(self, spaces: Spaces, model: ObservationModel, keyframe: int, motion: Motion) -> None:
        self.motion = motion
        self._spaces, self._model, self._keyframe = spaces, model, keyframe
        self._geometry: dict[tuple[int, int], Any] = {}

    @cached_property
    def odometry(self) -> Any:
        """Of the motion from the keyframe before, and of what odometry always gets wrong where that is estimated."""
        motion, keys = self.motion, (robot_key(self._keyframe - 1), robot_key(self._keyframe))
        if motion.by_bias is None:
            return self._spaces.robot.between_factor(*keys, motion.control, motion.covariance)
        return biased_factor((*keys, bias_key(self._keyframe)), motion.control, motion.covariance, motion.by_bias)

    def geometry(self, item: AssociatedDetection) -> Any:
        """Of a detection as one of an object's."""
        name = id(item.detection), item.object_id
        if name not in self._geometry:
            keys = robot_key(self._keyframe), object_key(item.object_id)
            self._geometry[name] = self._model.geometry_factor(item.detection, keys)
        return self._geometry[name]
