"""The factors of one keyframe that its hypotheses share: GTSAM never changes them."""

from typing import Any

from semantic_slam.inference.models.correlated_errors import ErrorTransition
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.odometry_bias import biased_factor
from semantic_slam.inference.models.step import AssociatedDetection, Motion
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import bias_key, error_keys, error_place, object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces


class KeyframeFactors:
    """Odometry to a keyframe, and geometry of its detections; each is made once."""

    def __init__(self, spaces: Spaces, model: ObservationModel, keyframe: int, motion: Motion) -> None:
        self._motion = motion
        self._spaces, self._model, self._keyframe = spaces, model, keyframe
        self._odometry: dict[int, Any] = {}
        self._geometry: dict[tuple[int, int], Any] = {}
        self._errors: Any = None

    @property
    def has_biases(self) -> bool:
        """Whether what odometry always gets wrong is estimated."""
        return self._motion.by_bias is not None

    def odometry(self, component: Component) -> Any:
        """Factor of the motion from the keyframe before, and of the odometry's biases where those are estimated.

        Components share it unless each has a clock of its own.
        """
        name = 0 if self._motion.shifts is None else id(component)
        if name not in self._odometry:
            self._odometry[name] = self._moving(component.moved_by(self._motion))
        return self._odometry[name]

    def _moving(self, motion: Motion) -> Any:
        keys = robot_key(self._keyframe - 1), robot_key(self._keyframe)
        if motion.by_bias is None:
            return self._spaces.robot.between_factor(*keys, motion.control, motion.covariance)
        return biased_factor((*keys, bias_key(self._keyframe)), motion.control, motion.covariance, motion.by_bias)

    def geometry(self, item: AssociatedDetection, errors: ErrorTransition | None) -> Any:
        """Factor of a detection that is associated with an object, and of its error where errors repeat."""
        name = id(item.detection), item.object_id
        if name not in self._geometry:
            keys = robot_key(self._keyframe), object_key(item.object_id)
            factor = self._model.geometry_factor(item.detection, keys)
            if errors is not None:
                place = error_place(self._keyframe, len(errors.places), item.number)
                factor = errors.white.factor(factor, place)
            self._geometry[name] = factor
        return self._geometry[name]

    def errors(self, transition: ErrorTransition) -> Any:
        """Factor of the errors that repeat, from those of the newest frame before; all hypotheses have one."""
        if self._errors is None:
            before = error_keys(transition.before, transition.matrix.shape[1] // 2)
            self._errors = transition.factor(before, error_keys(self._keyframe, len(transition.places)))
        return self._errors
