"""What the boxes of an object tell of its size, and so of what it is; and which object a box is of.

The logarithm of an object's size is a Gaussian about what its class is known for. A view shows that size but for how
the object is turned and what stands before it, and but for what is not known of its range; some views, of halves or of
two things as one, show any size at all:

    P(view | class, earlier) = (1 - e) N(view; mean, variance + of the view) + e N(view; of anything).

Views count one after the other. Whether one is an outlier is averaged over: mean and variance of the size are matched
to the mixture.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import LOG_2PI

MEAN_OF_ANY, SIGMA_OF_ANY = float(np.log(0.25)), 1.0
"""Mean and standard deviation of the logarithm of a size [m] that is not known: mostly a tenth to seven tenths."""


@dataclass(frozen=True, kw_only=True)
class SizeRecord:
    """What the boxes of one object have told, if it is of each of C classes."""

    log_likelihood: Array  # (C,) of all views
    mean: Array  # (C,) of the logarithm of its size in metres
    variance: Array  # (C,)


@dataclass(frozen=True, kw_only=True)
class SizeModel:
    """Sizes of C classes, and how views show them."""

    means: Array  # (C,) of the logarithm of a size in metres
    variances: Array  # (C,)
    view_variance: float  # of the logarithm of the size that a view shows
    outlier_share: float  # e

    @classmethod
    def of(
        cls, class_names: Sequence[str], sizes_m: Mapping[str, float], sigma: float, sigma_view: float, share: float
    ) -> Self:
        """With the sizes [m] that some classes, in lower case, are known for, and the ``sigma`` of their logarithms."""
        known = [sizes_m.get(name.lower()) for name in class_names]
        return cls(
            means=np.array([MEAN_OF_ANY if size is None else np.log(size) for size in known]),
            variances=np.array([SIGMA_OF_ANY if size is None else sigma for size in known]) ** 2,
            view_variance=sigma_view**2,
            outlier_share=share,
        )

    def start(self) -> SizeRecord:
        """Nothing seen yet."""
        return SizeRecord(log_likelihood=np.zeros(len(self.means)), mean=self.means, variance=self.variances)

    def log_densities(self, means: Array, variances: Array, log_size: Array, variance: Array) -> Array:
        """(...,) of views that show sizes, with the variances of their ranges' logarithms, of what is known so."""
        inlier, outlier = self._log_parts(means, variances, log_size, variance)
        return np.asarray(np.logaddexp(inlier, outlier))

    def after(self, record: SizeRecord, log_size: float, variance: float) -> SizeRecord:
        """With one more view, whose range has a ``variance`` of its logarithm."""
        inlier, outlier = self._log_parts(record.mean, record.variance, log_size, variance)
        density = np.logaddexp(inlier, outlier)
        share = np.exp(inlier - density)
        gain = record.variance / (record.variance + self.view_variance + variance)
        step = gain * (log_size - record.mean)
        return SizeRecord(
            log_likelihood=record.log_likelihood + density,
            mean=record.mean + share * step,
            variance=(1.0 - share * gain) * record.variance + share * (1.0 - share) * step**2,
        )

    def _log_parts(
        self, means: Array, variances: Array, log_size: Array | float, variance: Array | float
    ) -> tuple[Array, Array]:
        """(...,) log joint densities of views with being no outlier, and with being one."""
        inlier = _log_normal(log_size - means, variances + self.view_variance + variance)
        outlier = _log_normal(log_size - MEAN_OF_ANY, SIGMA_OF_ANY**2 + variance)
        return inlier + np.log1p(-self.outlier_share), outlier + np.log(self.outlier_share)


def _log_normal(off: Array | float, variance: Array | float) -> Array:
    return np.asarray(-0.5 * (off**2 / variance + np.log(variance) + LOG_2PI))
