"""The class of an object that a hypothesis adds: in a room full of chairs the next thing is likely to be one, too.

Shares of classes before a run count as some objects, and the objects of the hypothesis count besides, each by what is
told of its class so far (Polya's urn, with expected counts). Every object keeps the shares that it was first seen with.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True, kw_only=True)
class NewClasses:
    """C classes."""

    shares: Array  # (C,) before a run
    counts: float  # objects that these count as

    def log_ratios(self, known: Array) -> Array:
        """(C,) log of how many times as likely a class is beside objects of ``known`` (N, C) ones as before the run."""
        found = self.counts * self.shares + known.sum(axis=0)
        return np.asarray(np.log(found / (found.sum() * self.shares)))
