"""Robot poses with the constant errors of the sensor: what detections of moving objects are relative to."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Index, broadcast_copy


@dataclass(frozen=True, kw_only=True)
class Observers:
    """N poses of a robot in the plane, with d constant sensor errors each; d is 0 where these are not estimated."""

    robots: Array  # (N, 3)
    sensors: Array  # (N, d) in units of their prior standard deviations
    covariances: Array  # (N, 3 + d, 3 + d) in the tangent space of the pose, then of the errors

    @classmethod
    def of(cls, robots: Array, covariances: Array, sensors: Array, sensor_covariances: Array) -> Self:
        """From (N, 3) and (N, 3, 3) of the robot, (N, d) errors, and their (N, d, 3 + d) with robot and errors."""
        if not sensors.shape[1]:
            return cls(robots=robots, sensors=sensors, covariances=covariances)
        above = np.concatenate([covariances, np.swapaxes(sensor_covariances[..., :3], 1, 2)], axis=2)
        return cls(robots=robots, sensors=sensors, covariances=np.concatenate([above, sensor_covariances], axis=1))

    def take(self, rows: Index) -> "Observers":
        """Some of them, any number of times."""
        return Observers(robots=self.robots[rows], sensors=self.sensors[rows], covariances=self.covariances[rows])

    def shifts_from(self, robot: Array, sensor: Array) -> Array:
        """(N, 3 + d) tangent vectors to them from a reference pose (3,) and reference errors (d,)."""
        shifts = se2.log(se2.between(broadcast_copy(robot, self.robots.shape), self.robots))
        return np.concatenate([shifts, self.sensors - sensor], axis=1)
