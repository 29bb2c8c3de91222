"""Motion model of moving objects: a velocity that persists for a while, with one of a few typical speeds.

Each velocity component is an Ornstein-Uhlenbeck process, the Singer model of tracking (Singer, IEEE T-AES 6(4), 1970)
with velocity in place of acceleration: the position of an object unseen for long is unbounded, while its speed is not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import factorial

from semantic_slam.configuration import DetectionErrorsConfiguration, MovingConfiguration
from semantic_slam.configuration.labelled_numbers import labelled_numbers
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.models.correlated_errors import sensor_sigmas

SHORT = 0.5
"""Share of the steadiness within which a time is short."""
SERIES = 22
"""First power of a short time that is too small for double precision."""


@dataclass(frozen=True)
class Moving:
    """Prior knowledge of moving objects."""

    settings: MovingConfiguration = field(default_factory=MovingConfiguration)
    errors: DetectionErrorsConfiguration = field(default_factory=DetectionErrorsConfiguration)

    @cached_property
    def by_label(self) -> dict[str, float]:
        """Detector label in lower case -> share of its objects that may move. Raises InputError."""
        return labelled_numbers(
            "moving.share_by_label",
            self.settings.share_by_label,
            "LABEL=SHARE with a share in [0, 1)",
            lambda share: 0.0 <= share < 1.0,
        )

    @cached_property
    def largest_share(self) -> float:
        """Largest share of any label. Raises InputError."""
        return max(self.settings.share, *self.by_label.values(), 0.0)

    @property
    def is_on(self) -> bool:
        """Whether anything may move. Raises InputError."""
        return self.largest_share > 0.0

    @cached_property
    def speeds(self) -> Array:
        """(S,) standard deviations [m/s] of velocity components; 0: may move but stands still. Raises InputError."""
        speeds = self.settings.speeds_m_s
        if not speeds or min(speeds) < 0.0 or max(speeds) == 0.0:
            raise InputError("moving.speeds_m_s must not be negative, and one at least positive; correct them")
        return np.array(speeds)

    @cached_property
    def stands(self) -> Flags:
        """(S,) whether an object stands still under a speed setting. Raises InputError."""
        return np.asarray(self.speeds == 0.0)

    @cached_property
    def sensor_sigmas(self) -> Array:
        """(d,) prior standard deviations of the constant sensor errors, range offset [m] and yaw [rad], if any."""
        return sensor_sigmas(self.errors)

    def shares(self, labels: Sequence[str]) -> Array:
        """(D,) prior probabilities that the objects of detections with these labels move."""
        return np.array([self.by_label.get(label.lower(), self.settings.share) for label in labels], dtype=np.float64)

    def transition(self, elapsed_s: float) -> Array:
        """(4, 4) state transition of x, y and their rates."""
        return _in_both(self.unit_transition(elapsed_s))

    def noise(self, elapsed_s: float) -> Array:
        """(S, 4, 4) process noise covariances of that transition, by speed."""
        return np.asarray(self.speeds[:, None, None] ** 2 * _in_both(self.unit_noise(elapsed_s)))

    def unit_transition(self, elapsed_s: float) -> Array:
        """(2, 2) state transition of one coordinate and its rate."""
        steady, ratio = self.settings.steadiness_s, elapsed_s / self.settings.steadiness_s
        return np.array([[1.0, -steady * np.expm1(-ratio)], [0.0, np.exp(-ratio)]])

    def unit_noise(self, elapsed_s: float) -> Array:
        """(2, 2) process noise covariance of one coordinate and its rate, for a speed of 1 m/s."""
        steady, ratio = self.settings.steadiness_s, elapsed_s / self.settings.steadiness_s
        lost = -np.expm1(-ratio)
        both = steady * lost**2
        return np.array([[steady**2 * _scattered(ratio), both], [both, -np.expm1(-2.0 * ratio)]])

    def repeats(self, control: Array, driven: Array, variance: Array) -> Array:
        """(..., 2) correlation of one object's range and bearing errors with those before a robot motion (3,).

        ``driven`` (..., 2) [m] is the object's own displacement, known with ``variance`` (...) along each axis: the
        kernel over places (see ``correlated_errors``) is averaged over that Gaussian.
        """
        settings, square = self.errors, self.errors.neighbour_m**2
        motion = np.hypot(*control[:2]) / settings.motion_m + abs(control[2]) / settings.motion_rad
        near = np.exp(-0.5 * (driven**2).sum(axis=-1) / (square + variance)) / (1.0 + variance / square)
        common = np.array([settings.common_range_share, settings.common_bearing_share])
        return np.asarray(np.exp(-motion) * (common + (1.0 - common) * near[..., None]))


def _scattered(ratio: float) -> float:
    """2 x - 2 (1 - e^-x) - (1 - e^-x)^2 of a ``ratio`` x, which is near 2 x^3 / 3 for short times.

    The terms would cancel there: a series in x takes their place.
    """
    if ratio > SHORT:
        lost = -np.expm1(-ratio)
        return float(2.0 * ratio - 2.0 * lost - lost**2)
    powers = np.arange(3, SERIES)
    return float(((4.0 - 2.0**powers) * (-ratio) ** powers / factorial(powers)).sum())


def _in_both(unit: Array) -> Array:
    """(4, 4) matrix over x, y and their rates that acts on each coordinate and its rate as ``unit`` (2, 2)."""
    found = np.zeros((4, 4))
    found[::2, ::2] = found[1::2, 1::2] = unit
    return found
