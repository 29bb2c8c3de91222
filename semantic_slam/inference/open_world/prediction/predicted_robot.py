"""The predicted robot of one hypothesis, after a motion and a gravity measurement, with jointly known quantities."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.correlated_errors import CHANGE_OF_SENSOR
from semantic_slam.inference.models.odometry_bias import with_changed_bias
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.open_world.moving.moving_objects import RobotMotion
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.smoothing.local_map import LocalMap
from semantic_slam.inference.states.tracked_objects import TrackedStates


@dataclass(frozen=True, kw_only=True)
class PredictedRobot:
    """The predicted robot of a component; r tangent dimensions, p odometry biases."""

    component: Component
    noise: Motion  # with the noise that the component assumes
    control: Array  # (s,) odometry corrected by the estimated biases
    transition: Array  # (r, r + p)
    before: Array  # (r + p, r + p) covariance before the motion
    as_moved: Array  # (s,) prediction by odometry alone
    state: Array  # (s,)
    covariance: Array  # (r, r)
    log_level: float = 0.0  # log density of the gravity measurement, if any

    @classmethod
    def of(cls, component: Component, motion: Motion) -> "PredictedRobot":
        """The robot after ``motion``, with the noise that the component assumes."""
        noise, space, tracked = component.moved_by(motion), component.spaces.robot, tracked_states(component)
        control = _control(component, noise)
        transition = space.propagation(control)
        if noise.by_bias is not None:
            transition = np.concatenate([transition, noise.by_bias], axis=1)
        before = with_changed_bias(tracked.motion_covariance, component.keyframe + 1, len(tracked.bias))
        before = before[: transition.shape[1], : transition.shape[1]]
        state = as_moved = space.compose(tracked.robot, control)
        covariance, log_level = transition @ before @ transition.T + noise.covariance, 0.0
        if noise.gravity is not None:
            level = noise.gravity.levels(as_moved, covariance)
            state, covariance, log_level = space.retract(state, level.shift), level.covariance, level.log_evidence
        return cls(
            component=component,
            noise=noise,
            control=control,
            transition=transition,
            before=before,
            as_moved=as_moved,
            state=state,
            covariance=covariance,
            log_level=log_level,
        )

    def motion(self, num_sensor: int, *, drifts: bool) -> RobotMotion:
        """The motion from the previous keyframe to this one, with the sensor's d = ``num_sensor`` constant errors.

        ``drifts``: whether these change, as they do from one frame with detections to the next.
        """
        tracked, size, width = tracked_states(self.component), len(self.covariance), self.transition.shape[1]
        sensor, within, with_moved = _sensor_before(tracked, num_sensor, width)
        cross = self.before[:size] @ self.transition.T
        by_robot, by_moved = with_moved[:, :size], with_moved @ self.transition.T
        change = CHANGE_OF_SENSOR**2 * np.eye(num_sensor) if drifts else 0.0
        return RobotMotion(
            before=tracked.robot,
            after=self.state,
            sensor=sensor,
            covariance_before=np.block([[tracked.robot_covariance, by_robot.T], [by_robot, within]]),
            cross=np.block([[cross, by_robot.T], [by_moved, within]]),
            covariance=np.block([[self.covariance, by_moved.T], [by_moved, within + change]]),
            control=self.control,
        )

    def moved(self, local: LocalMap) -> tuple[LocalMap, Array | None]:
        """The local map after the motion, and the shift of its means by gravity; None: gravity is not measured."""
        before = with_changed_bias(local.covariance, self.component.keyframe + 1, local.num_biases)
        local = local.moved(self.state, before, self.transition, self.noise.covariance)
        return local.levelled(self.noise.gravity, self.as_moved)

    def with_objects(self, near: Index, local: LocalMap, shift: Array | None) -> PredictedBelief:
        """b^-[x_k, O] (Eqs. 4.11, 4.21) over the robot and near objects, with the means shifted by gravity."""
        spaces, ids = self.component.spaces, self.component.objects.ids[near]
        states = tracked_states(self.component).states[near]
        if shift is not None and len(near):
            rows = local.rows(ids)[spaces.layout.robot :].reshape(len(near), -1)
            states = spaces.landmark.retract(states, shift[rows])
        mean = spaces.storage.stacked(self.state[None], states)
        return PredictedBelief(spaces.layout, mean[None], local.of(ids)[None])


def _control(component: Component, motion: Motion) -> Array:
    if motion.by_bias is None:
        return motion.control
    return component.spaces.robot.retract(motion.control, motion.by_bias @ tracked_states(component).bias)


def _sensor_before(tracked: TrackedStates, num_sensor: int, width: int) -> tuple[Array, Array, Array]:
    """(d,) expected constant sensor errors, their (d, d) covariance, and their (d, w) with robot and biases."""
    if tracked.errors is None or not num_sensor:
        return np.zeros(num_sensor), np.eye(num_sensor), np.zeros((num_sensor, width))
    rows = tracked.motion_covariance[-num_sensor:]
    return tracked.errors.mean[-num_sensor:], rows[:, -num_sensor:], rows[:, :width]
