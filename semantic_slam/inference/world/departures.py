"""Departure rates: how soon static objects leave for good, one rate for all or by the detector's label."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.configuration.labelled_numbers import labelled_numbers
from semantic_slam.geometry.arrays import Array, Index


@dataclass(frozen=True)
class Departures:
    """Departure rates per hour; an object's label is that of the detection from which it was born."""

    settings: OpenWorldConfiguration
    label_of: Callable[[int], str] = lambda _: ""

    @cached_property
    def by_label(self) -> dict[str, float]:
        """Rate per hour by the detector's label in lower case. Raises InputError."""
        return labelled_numbers(
            "open_world.departures_by_label",
            self.settings.departures_by_label,
            "LABEL=RATE per hour, 0 or more",
            lambda rate: 0.0 <= rate < np.inf,
        )

    @property
    def is_on(self) -> bool:
        """Whether objects may leave, or may have left before the run. Raises InputError."""
        rates = [self.settings.departures_per_hour, *self.by_label.values()]
        return self.settings.departed_share > 0.0 or max(rates) > 0.0

    def per_hour(self, object_ids: Index) -> Array | float:
        """(O, 1) rates of the objects, or a scalar where all have one rate. Raises InputError."""
        every = self.settings.departures_per_hour
        if not self.by_label:
            return every
        labels = [self.label_of(number).lower() for number in object_ids.tolist()]
        return np.array([self.by_label.get(label, every) for label in labels], dtype=np.float64).reshape(-1, 1)
