"""Distances over which first detections are summed: rings of the region in the plane, shells in space.

Where detection falls off with distance, rings of equal area miss the near field of a long range. Rings then hold equal
parts of the first detections expected, averaged over typical half ranges, and the fall-off is averaged over each ring.
They are the same for all half ranges, so that settings of the rates are independent of each other.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from semantic_slam.geometry.arrays import Array

SHARES = np.linspace(0.0, 1.0, 513) ** 3
"""Shares of the area or volume from the nearest distance on, denser there, over which the fall-off is integrated."""
TYPICAL = np.array([0.05, 0.2, np.inf, np.inf])
"""Half ranges, as shares of the farthest distance, by which rings are chosen."""
NUM_EVEN, NUM_FALLING = 4, 8
"""Number of rings where detection does not fall off with distance, and where it does."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rings:
    """R rings, or in space shells, that cover the region from its nearest to its farthest distance.

    Equal to themselves alone, so that what follows from them may be kept by them.
    """

    ranges_m: Array  # (R,) sample distances, one in each
    shares: Array  # (R,) of the area or volume
    fall_off: Array  # (R, P) mean detection probability, as share of that at the sensor, for P half ranges


@lru_cache(maxsize=256)
def rings(
    nearest_m: float,
    farthest_m: float,
    half_ranges_m: tuple[float, ...],
    dimension: int,
    even: int = NUM_EVEN,
    falling: int = NUM_FALLING,
) -> Rings:
    """The rings for P ``half_ranges_m`` of the half-normal fall-off; ``dimension`` is 2 in the plane, 3 in space.

    ``even`` many of equal size if all half ranges are infinite, else ``falling`` many.
    """
    half_ranges, inner, outer = np.array(half_ranges_m), nearest_m**dimension, farthest_m**dimension
    if not np.isfinite(half_ranges).any():
        middles = (np.arange(even) + 0.5) / even
        ones = np.ones((even, len(half_ranges)))
        return Rings(
            ranges_m=_roots(inner + middles * (outer - inner), dimension),
            shares=np.full(even, 1.0 / even),
            fall_off=ones,
        )
    ranges = _roots(inner + SHARES * (outer - inner), dimension)
    typical = _sums(ranges, TYPICAL * farthest_m)
    middles = np.interp((np.arange(falling) + 0.5) / falling, (typical / typical[-1]).mean(axis=1), SHARES)
    edges = np.concatenate([[0.0], 0.5 * (middles[1:] + middles[:-1]), [1.0]])
    within = np.diff([np.interp(edges, SHARES, own) for own in _sums(ranges, half_ranges).T], axis=1).T
    return Rings(
        ranges_m=_roots(inner + middles * (outer - inner), dimension),
        shares=np.diff(edges),
        fall_off=within / np.diff(edges)[:, None] * np.exp2(-((nearest_m / half_ranges) ** 2)),
    )


def _sums(ranges_m: Array, half_ranges_m: Array) -> Array:
    """(N, P) fall-off summed up to each of ``ranges_m`` (N,), at :data:`SHARES`, as share of that at the nearest."""
    density = np.exp2(-(ranges_m[:, None] ** 2 - ranges_m[0] ** 2) / half_ranges_m**2)
    found = np.zeros(density.shape)
    np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(SHARES)[:, None], axis=0, out=found[1:])
    return found


def _roots(values: Array, dimension: int) -> Array:
    """(...,) square or cube roots."""
    return np.sqrt(values) if dimension == 2 else np.cbrt(values)
