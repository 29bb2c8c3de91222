"""Novelty test: whether the views of an object, taken together, are covered by the data of the class models.

A share alpha of the views of known objects is falsely flagged as novel ("strange"), so that among many views of any
object some are. Views from nearly the same direction look alike and are flagged together: they form one look. A look is
strange if at least half of its views are, which happens to at most 2 alpha of the looks at known objects, however
dependent the views of a look are (Markov's inequality for the share of strange views). Looks are taken as independent:
S strange looks of L are tested against the binomial distribution, with a Bonferroni correction over a run's objects.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import bdtrc

LOOK_RAD = float(np.radians(15.0))
"""Angular width of one look; for simulated furniture, strangeness is correlated within some 20 degrees."""
SIGNIFICANCE = 0.01
"""Significance level: share of the runs over known objects alone in which one of them may be called strange."""


@dataclass(frozen=True)
class ViewCoverage:
    """Statistics of the looks at one object so far."""

    looks: Mapping[int, tuple[int, int]] = field(default_factory=dict)  # cell of direction -> (views, strange views)
    is_fitted: bool = True  # every view was from a direction that the likeliest class's model was fitted on

    def with_view(self, azimuth_rad: float, *, is_recognised: bool, is_fitted: bool = True) -> "ViewCoverage":
        """Add a view; ``azimuth_rad`` is that of the camera about the object, always from the same axis."""
        cell = int(np.floor((azimuth_rad % (2.0 * np.pi)) / LOOK_RAD))
        views, strange = self.looks.get(cell, (0, 0))
        looks = {**self.looks, cell: (views + 1, strange + (not is_recognised))}
        return replace(self, looks=looks, is_fitted=self.is_fitted and is_fitted)

    def holds(self, false_alarms: float, num_objects: int) -> bool:
        """Whether the test does not reject that the models know the object, one of ``num_objects`` that are tested.

        ``false_alarms`` is alpha, the share of the views of known objects that are not recognised. A single view from a
        direction that the model was not fitted on rejects it.
        """
        strange = sum(2 * missed >= views for views, missed in self.looks.values())
        by_chance = bdtrc(strange - 1, len(self.looks), min(2.0 * false_alarms, 1.0)) if strange else 1.0
        return self.is_fitted and bool(by_chance > SIGNIFICANCE / max(num_objects, 1))


NO_VIEWS = ViewCoverage()
"""The coverage of an object without views."""
