"""The factors of one keyframe that its hypotheses share; GTSAM never modifies them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.inference.models.correlated_errors import ErrorTransition
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.odometry_bias import biased_factor
from semantic_slam.inference.models.step import AssociatedDetection, Motion
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.linear.measured import Measured, Motions, Sightings
from semantic_slam.inference.states.keys import bias_key, error_keys, error_place, object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces


class KeyframeFactors:
    """Odometry to a keyframe, gravity there, and geometry of its detections; each factor is made once."""

    def __init__(self, spaces: Spaces, model: ObservationModel, keyframe: int, motion: Motion) -> None:
        self._motion = motion
        self._spaces, self._model, self._keyframe = spaces, model, keyframe
        self._odometry: dict[int, Any] = {}
        self._level: Any | None = None
        self._geometry: dict[tuple[int, int], Any] = {}
        self._errors: dict[tuple[bytes, bytes], Any] = {}

    @property
    def has_biases(self) -> bool:
        """Whether constant errors of odometry (biases) are estimated."""
        return self._motion.by_bias is not None

    def odometry(self, component: Component) -> Any:
        """Factor of the motion from the previous keyframe, and of odometry biases where those are estimated.

        Components share it unless each has a clock offset of its own.
        """
        name = 0 if self._motion.shifts is None else id(component)
        if name not in self._odometry:
            self._odometry[name] = self._moving(component.moved_by(self._motion))
        return self._odometry[name]

    def level(self) -> Any | None:
        """Factor of the direction of gravity; None where it is not measured."""
        if self._level is None and self._motion.gravity is not None:
            self._level = self._motion.gravity.factor(robot_key(self._keyframe))
        return self._level

    def _moving(self, motion: Motion) -> Any:
        keys = robot_key(self._keyframe - 1), robot_key(self._keyframe)
        if motion.by_bias is None:
            return self._spaces.robot.between_factor(*keys, motion.control, motion.covariance)
        return biased_factor((*keys, bias_key(self._keyframe)), motion.control, motion.covariance, motion.by_bias)

    def geometry(self, item: AssociatedDetection) -> Any:
        """Factor of a detection that is associated with an object."""
        name = id(item.detection), item.object_id
        if name not in self._geometry:
            keys = robot_key(self._keyframe), object_key(item.object_id)
            self._geometry[name] = self._model.geometry_factor(item.detection, keys)
        return self._geometry[name]

    def measured(self, component: Component, update: ComponentUpdate) -> list[Measured]:
        """The motion and the associated detections, for a smoother that holds measurements linear in charts."""
        motion = component.moved_by(self._motion)
        found: list[Measured] = [Motions.one(self._keyframe, motion.control, motion.covariance, motion.by_bias)]
        if update.observed and update.errors is not None:
            found.append(self._sightings(update.observed, update.errors))
        return found

    def _sightings(self, observed: Sequence[AssociatedDetection], errors: ErrorTransition) -> Sightings:
        places = [error_place(self._keyframe, errors.count, item.number) for item in observed]
        keys, firsts, sizes = (np.array(column) for column in zip(*places, strict=True))
        ranged = np.array([item.detection.has_range for item in observed], dtype=bool)
        return Sightings(
            scale=np.full(len(observed), errors.white.scale),
            seen=self._model.collect([item.detection for item in observed]),
            rows=np.full(len(observed), self._keyframe + 1),
            ids=np.array([item.object_id for item in observed]),
            by_error=errors.white.slopes(ranged) / np.array([item.width for item in observed])[:, None],
            keys=keys,
            firsts=firsts,
            sizes=sizes,
            offset=np.zeros((len(observed), 2)),
        )

    def errors(self, transition: ErrorTransition) -> Any:
        """Factor of the correlated errors, from those of the newest frame before.

        Hypotheses share it if they assume equal sensor noise, which scales the constant sensor errors, and equal
        motion, as the correlation decays with distance travelled: each may have a clock offset of its own.
        """
        name = transition.matrix.tobytes(), transition.noise.tobytes()
        if name not in self._errors:
            before = error_keys(transition.before, transition.matrix.shape[1] // 2)
            self._errors[name] = transition.factor(before, error_keys(self._keyframe, transition.count))
        return self._errors[name]
