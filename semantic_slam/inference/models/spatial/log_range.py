"""Prior of an unmeasured range: a Gaussian over its logarithm.

A new object may be anywhere along its ray within the region: log-uniform between the region's least and largest range.
The typical size of its kind, with the apparent size of its box, says more; that evidence repeats in every view of one
object, so it counts once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.special import ndtr

LEAST_SHARE = 0.01
"""Least range, as a share of the largest, where a region begins at the camera: logarithms need a lower bound."""
LEAST_INSIDE = 1e-3
"""Probability of lying inside the region below which size estimates are rejected as not of this object."""


@dataclass(frozen=True)
class LogRange:
    """Mean and standard deviation of the logarithm of a range in metres."""

    mean: float
    sigma: float

    @property
    def range_m(self) -> float:
        """The range at the mean."""
        return float(np.exp(self.mean))

    @classmethod
    def between(cls, least_m: float, most_m: float) -> Self:
        """With the moments of a log-uniform range between two ranges."""
        low, high = _ends(least_m, most_m)
        return cls(0.5 * (low + high), (high - low) / float(np.sqrt(12.0)))

    @classmethod
    def of_sizes(cls, ranges: "Sequence[LogRange]", shares: Sequence[float], least_m: float, most_m: float) -> Self:
        """With the moments of the ranges by several sizes with prior ``shares``, truncated to a region.

        Each counts by its share and by its probability inside; those of the whole region where that is hardly any.
        """
        parts = [own.within(least_m, most_m) for own in ranges]
        weights = np.array([share * part.inside for share, part in zip(shares, parts, strict=True)])
        if weights.sum() < LEAST_INSIDE:
            return cls.between(least_m, most_m)
        weights /= weights.sum()
        means, variances = np.array([part.mean for part in parts]), np.array([part.sigma**2 for part in parts])
        mean = float(weights @ means)
        return cls(mean, float(np.sqrt(weights @ (variances + (means - mean) ** 2))))

    def within(self, least_m: float, most_m: float) -> "Truncated":
        """Moments and probability of the part in a region; where it is next to none, those of the whole region."""
        low, high = _ends(least_m, most_m)
        a, b = (low - self.mean) / self.sigma, (high - self.mean) / self.sigma
        inside = float(ndtr(b) - ndtr(a))
        if inside < LEAST_INSIDE:
            whole = LogRange.between(least_m, most_m)
            return Truncated(whole.mean, whole.sigma, inside)
        at_a, at_b = (float(np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)) for z in (a, b))
        shift = (at_a - at_b) / inside
        share = 1.0 + (a * at_a - b * at_b) / inside - shift**2
        return Truncated(self.mean + self.sigma * shift, self.sigma * float(np.sqrt(share)), inside)


class Truncated(NamedTuple):
    """The part of a :class:`LogRange` in a region."""

    mean: float
    sigma: float
    inside: float  # probability


def _ends(least_m: float, most_m: float) -> tuple[float, float]:
    """Logarithms of a region's ranges."""
    return float(np.log(max(least_m, LEAST_SHARE * most_m))), float(np.log(most_m))


ANYWHERE = LogRange.between(0.3, 5.0)
"""For a region with the default limits of the configuration."""
