"""Errors of detections that repeat, drawn from their process: written anew, so that it checks the engine's."""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.geometry.arrays import Array

OWN = 1e-4
"""Share that no two detections have in common."""
SAME_M = 0.05
"""Distance below which two places are one."""
LEAST_LEFT = 0.02
"""Correlation below which a place that was detected before is forgotten."""


@dataclass
class RepeatedErrors:
    """f at all places detected so far, also those that a frame misses: Gauss-Markov from one frame to the next."""

    settings: DetectionErrorsConfiguration
    places: Array = field(default_factory=lambda: np.zeros((0, 2)))  # (n, 2) in the body frame of the newest frame
    values: Array = field(default_factory=lambda: np.zeros((0, 2)))  # (n, 2) of range and bearing
    left_of_each: Array = field(default_factory=lambda: np.zeros(0))  # (n,) correlation with the last detection there
    left: float = 1.0  # correlation that the motion since the newest detections has left

    def move(self, control: Array) -> None:
        """The robot moves by (3,)."""
        cos, sin = np.cos(control[2]), np.sin(control[2])
        self.places = (self.places - control[:2]) @ np.array([[cos, -sin], [sin, cos]])
        self.left *= np.exp(
            -np.hypot(*control[:2]) / self.settings.motion_m - abs(control[2]) / self.settings.motion_rad
        )

    def draw(self, places: Array, random: np.random.Generator) -> Array:
        """(D, 2) of a new frame with detections at ``places`` (D, 2) in the body frame."""
        common = (self.settings.common_range_share, self.settings.common_bearing_share)
        apart = np.linalg.norm(self.places[:, None] - places, axis=-1).min(axis=1, initial=np.inf) > SAME_M
        missed = apart & (self.left * self.left_of_each > LEAST_LEFT)
        every = np.concatenate([places, self.places[missed]])
        drawn = np.stack([self._component(every, at, share, random) for at, share in enumerate(common)], axis=1)
        self.left_of_each = np.append(np.ones(len(places)), self.left * self.left_of_each[missed])
        self.places, self.values, self.left = every, drawn, 1.0
        return drawn[: len(places)]

    def _component(self, places: Array, at: int, common: float, random: np.random.Generator) -> Array:
        own = self._kernel(places, places, common) + OWN * np.eye(len(places))
        before = self._kernel(self.places, self.places, common) + OWN * np.eye(len(self.places))
        cross = self.left * self._kernel(places, self.places, common)
        gain = np.linalg.solve(before, cross.T).T
        spread = own - gain @ cross.T
        return np.asarray(gain @ self.values[:, at] + random.multivariate_normal(np.zeros(len(places)), spread))

    def _kernel(self, one: Array, other: Array, common: float) -> Array:
        squared = ((one[:, None] - other[None]) ** 2).sum(axis=-1)
        near = np.exp(-0.5 * squared / self.settings.neighbour_m**2)
        return np.asarray((1.0 - OWN) * (common + (1.0 - common) * near))
