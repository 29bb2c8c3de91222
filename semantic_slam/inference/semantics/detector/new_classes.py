"""Class prior of a new object given the others: in a room full of chairs the next thing is likely a chair, too.

Class frequencies from before a run count as some number of objects, and the objects of the hypothesis count in
addition, each by its class posterior (Polya's urn with expected counts). Every object keeps the prior of its first
detection.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True, kw_only=True)
class NewClasses:
    """Class frequencies of C classes."""

    shares: Array  # (C,) before a run
    counts: float  # number of objects that they count as

    def log_ratios(self, known: Array) -> Array:
        """(C,) log ratio of the class prior beside objects with posteriors ``known`` (N, C) to that before the run."""
        found = self.counts * self.shares + known.sum(axis=0)
        return np.asarray(np.log(found / (found.sum() * self.shares)))
