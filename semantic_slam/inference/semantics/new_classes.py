"""Of which class an object is that a hypothesis adds: in a room full of chairs the next thing is likely to be one, too.

Shares of classes before a run count as some objects, and the objects of the hypothesis count besides, each by what is
told of its class so far (Polya's urn, with expected counts). Every object keeps the shares that it was added with.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.object_views import ObjectViews, class_posterior


@dataclass(frozen=True, kw_only=True)
class NewClasses:
    """C classes."""

    shares: Array  # (C,) before a run
    counts: float  # objects that these count as

    def log_ratios(self, views: Mapping[int, ObjectViews]) -> Array:
        """(C,) log of how many times as likely a class is beside objects with ``views`` as before the run."""
        if not views:
            return np.zeros(len(self.shares))
        told = np.array(
            [views[number].log_likelihood for number in sorted(views)]
        )  # in one order, whoever rebuilt them
        found = self.counts * self.shares + class_posterior(np.log(self.shares), told).sum(axis=0)
        return np.asarray(np.log(found / (found.sum() * self.shares)))
