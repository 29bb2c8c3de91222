"""What is known of a range that nobody measured, before its object is known: a Gaussian over its logarithm.

An object may be anywhere along the ray that the region holds: the logarithm of its range is even between the region's
least and largest one. How large its kind is, beside how large its box looks, tells more; the truth repeats in every
view of the same object, and so it counts once.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

LEAST_SHARE = 0.01
"""Share of the largest range below which none counts where a region begins at the camera: logarithms have an end."""
LEAST_INSIDE = 1e-3
"""Probability of lying inside the region below which a size is not that of this object: it says nothing then."""


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
    def between(cls, least_m: float, most_m: float) -> "LogRange":
        """With the moments of one that is even from one range to another one."""
        low, high = _ends(least_m, most_m)
        return cls(0.5 * (low + high), (high - low) / float(np.sqrt(12.0)))

    def within(self, least_m: float, most_m: float) -> "LogRange":
        """With the moments of what lies within a region; all of the region where hardly any does."""
        low, high = _ends(least_m, most_m)
        a, b = (low - self.mean) / self.sigma, (high - self.mean) / self.sigma
        inside = float(ndtr(b) - ndtr(a))
        if inside < LEAST_INSIDE:
            return LogRange.between(least_m, most_m)
        at_a, at_b = (float(np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)) for z in (a, b))
        shift = (at_a - at_b) / inside
        share = 1.0 + (a * at_a - b * at_b) / inside - shift**2
        return LogRange(self.mean + self.sigma * shift, self.sigma * float(np.sqrt(share)))


def _ends(least_m: float, most_m: float) -> tuple[float, float]:
    """Logarithms of a region's ranges."""
    return float(np.log(max(least_m, LEAST_SHARE * most_m))), float(np.log(most_m))


ANYWHERE = LogRange.between(0.3, 5.0)
"""In a region as wide as that of a configuration that says nothing."""
