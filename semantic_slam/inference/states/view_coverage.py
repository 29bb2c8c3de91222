"""Whether the views of an object, taken together, are ones that the class models were fitted on.

A share alpha of the pictures of known objects is taken for pictures of others, so that among many views of any object
some are. Views from nearly the same direction look alike and are mistaken together: they are one look. A look counts as
strange where at least half of its views are, which happens to at most 2 alpha of the looks at known objects however
much the views of a look depend on each other (Markov's inequality for the share of strange views). Looks count as
independent: S of L being strange is held against the binomial distribution, for all objects of a run together.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import bdtrc

LOOK_RAD = float(np.radians(15.0))
"""Directions of view of one look; of simulated furniture, strangeness repeats within some 20 degrees."""
SIGNIFICANCE = 0.01
"""Share of the runs over known objects alone in which one of them may be called strange."""


@dataclass(frozen=True)
class ViewCoverage:
    """The looks at one object so far."""

    looks: Mapping[int, tuple[int, int]] = field(default_factory=dict)  # direction's cell -> views, strange ones
    is_fitted: bool = True  # every view was from a direction that the likeliest class's model was fitted on

    def with_view(self, azimuth_rad: float, *, is_recognised: bool, is_fitted: bool = True) -> "ViewCoverage":
        """With one view more; ``azimuth_rad`` of the camera about the object, always from the same axis."""
        cell = int(np.floor((azimuth_rad % (2.0 * np.pi)) / LOOK_RAD))
        views, strange = self.looks.get(cell, (0, 0))
        looks = {**self.looks, cell: (views + 1, strange + (not is_recognised))}
        return replace(self, looks=looks, is_fitted=self.is_fitted and is_fitted)

    def holds(self, false_alarms: float, num_objects: int) -> bool:
        """Whether nothing says that the models do not know the object, one of ``num_objects`` that are judged.

        ``false_alarms``: share of the views of known objects that are not recognised. A direction that no model was
        fitted on is no false alarm: one such view is enough.
        """
        strange = sum(2 * missed >= views for views, missed in self.looks.values())
        by_chance = bdtrc(strange - 1, len(self.looks), min(2.0 * false_alarms, 1.0)) if strange else 1.0
        return self.is_fitted and bool(by_chance > SIGNIFICANCE / max(num_objects, 1))


NO_VIEWS = ViewCoverage()
"""What an object has that was not seen."""
