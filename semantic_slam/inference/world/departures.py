"""How soon what stands leaves for good: at one rate, or at one of its own by what the detector calls it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.configuration.labelled_numbers import labelled_numbers
from semantic_slam.geometry.arrays import Array, Index


@dataclass(frozen=True)
class Departures:
    """Rates per hour; an object is called as the detection that began it."""

    settings: OpenWorldConfiguration
    label_of: Callable[[int], str] = lambda _: ""

    @cached_property
    def by_label(self) -> dict[str, float]:
        """Detector's label, in lower case -> rate per hour. Raises InputError."""
        return labelled_numbers(
            "open_world.departures_by_label",
            self.settings.departures_by_label,
            "LABEL=RATE per hour, 0 or more",
            lambda rate: 0.0 <= rate < np.inf,
        )

    @property
    def is_on(self) -> bool:
        """Whether anything may leave, or may have left. Raises InputError."""
        rates = [self.settings.departures_per_hour, *self.by_label.values()]
        return self.settings.departed_share > 0.0 or max(rates) > 0.0

    def per_hour(self, object_ids: Index) -> Array | float:
        """(O, 1) rates of objects, or one rate of all. Raises InputError."""
        every = self.settings.departures_per_hour
        if not self.by_label:
            return every
        labels = [self.label_of(number).lower() for number in object_ids.tolist()]
        return np.array([self.by_label.get(label, every) for label in labels], dtype=np.float64).reshape(-1, 1)
