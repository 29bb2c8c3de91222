"""Prior of the range of objects seen without one: anywhere in the region, or by the typical size of their kind.

A label is right with the probability that the label model expects. Otherwise the object may have any size.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from semantic_slam.configuration import Configuration, NewObjectConfiguration
from semantic_slam.configuration.labelled_numbers import labelled_numbers
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.spatial.log_range import ANYWHERE, LogRange
from semantic_slam.viewpoint.size_model import MEAN_OF_ANY, SIGMA_OF_ANY

WIDEST_RAD = 2.5
"""Angles are clipped to this width: the tangent of half an angle is unbounded."""


@dataclass(frozen=True)
class UnmeasuredRanges:
    """Prior of the range of a new object before a second view."""

    anywhere: LogRange = ANYWHERE
    least_m: float = 0.3
    most_m: float = 5.0
    sizes_m: dict[str, float] = field(default_factory=dict)  # detector label in lower case -> size [m]
    sigma_log_size: float = 0.4
    sigma_log_view: float = 0.0
    label_accuracy: float = 0.75  # probability that a label is right

    @classmethod
    def of(cls, configuration: Configuration) -> Self:
        """The prior of ranges that the configuration describes. Raises InputError."""
        region, new = configuration.open_world, configuration.new_objects
        return cls(
            LogRange.between(region.min_range_m, region.max_range_m),
            region.min_range_m,
            region.max_range_m,
            sizes_by_label(new),
            new.sigma_log_size,
            new.sigma_log_view,
            configuration.semantic_model.label_accuracy,
        )

    def of_detection(self, label: str, angular_size_rad: Array) -> LogRange:
        """By label and the angles (2,) that the box's width and height subtend; NaN where the border cuts them."""
        size, seen = self.sizes_m.get(label.lower()), log_angle(angular_size_rad)
        if size is None or np.isnan(seen):
            return self.anywhere
        of_label = LogRange(float(np.log(size)) - seen, float(np.hypot(self.sigma_log_size, self.sigma_log_view)))
        of_any = LogRange(MEAN_OF_ANY - seen, float(np.hypot(SIGMA_OF_ANY, self.sigma_log_view)))
        shares = self.label_accuracy, 1.0 - self.label_accuracy
        return LogRange.of_sizes((of_label, of_any), shares, self.least_m, self.most_m)


def log_angle(angular_size_rad: Array) -> float:
    """Log of the apparent size of a box (2,), size per range; NaN where it is cut by the border.

    The size is the square root of width times height.
    """
    return float(np.log(2.0 * np.tan(0.5 * np.minimum(angular_size_rad, WIDEST_RAD))).mean())


def sizes_by_label(new: NewObjectConfiguration) -> dict[str, float]:
    """Metres by the detector's labels in lower case, as configured. Raises InputError."""
    return labelled_numbers(
        "new_objects.size_by_label",
        new.size_by_label,
        "LABEL=SIZE with metres above 0",
        lambda size: 0.0 < size < np.inf,
    )
