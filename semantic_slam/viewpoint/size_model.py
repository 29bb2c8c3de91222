"""Size likelihood: what an object's boxes say of its size, and thereby of its class and of association.

The log size of an object is Gaussian around the typical size of its class. A view measures that size up to the effects
of orientation, occlusion and range uncertainty; some views, of half an object or of two merged into one, show an
arbitrary size:

    P(view | class, earlier) = (1 - e) N(view; mean, variance + view variance) + e N(view; arbitrary size).

Views are processed sequentially. The outlier indicator is marginalised by moment matching: mean and variance of the
size are those of the mixture.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import LOG_2PI

MEAN_OF_ANY, SIGMA_OF_ANY = float(np.log(0.25)), 1.0
"""Mean and standard deviation of the log of an unknown size [m]: mostly 0.1 to 0.7 m."""


@dataclass(frozen=True, kw_only=True)
class SizeRecord:
    """Size estimate and likelihood of one object under each of C classes."""

    log_likelihood: Array  # (C,) of all views
    mean: Array  # (C,) of the logarithm of its size in metres
    variance: Array  # (C,)


@dataclass(frozen=True, kw_only=True)
class SizeModel:
    """Size priors of C classes, and the measurement model of views."""

    means: Array  # (C,) of the logarithm of a size in metres
    variances: Array  # (C,)
    view_variance: float  # of the log size measured by a view
    outlier_share: float  # e

    @classmethod
    def of(
        cls, class_names: Sequence[str], sizes_m: Mapping[str, float], sigma: float, sigma_view: float, share: float
    ) -> Self:
        """Model from the known sizes [m] of some classes (names in lower case), ``sigma`` being that of log sizes."""
        known = [sizes_m.get(name.lower()) for name in class_names]
        return cls(
            means=np.array([MEAN_OF_ANY if size is None else np.log(size) for size in known]),
            variances=np.array([SIGMA_OF_ANY if size is None else sigma for size in known]) ** 2,
            view_variance=sigma_view**2,
            outlier_share=share,
        )

    def start(self) -> SizeRecord:
        """Record of an object not yet seen."""
        return SizeRecord(log_likelihood=np.zeros(len(self.means)), mean=self.means, variance=self.variances)

    def log_densities(self, means: Array, variances: Array, log_size: Array, variance: Array) -> Array:
        """(...,) log densities of views' log sizes, with log-range variances, given size means and variances."""
        inlier, outlier = self._log_parts(means, variances, log_size, variance)
        return np.asarray(np.logaddexp(inlier, outlier))

    def after(self, record: SizeRecord, log_size: float, variance: float) -> SizeRecord:
        """Record with one more view, whose log range has ``variance``."""
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

    def log_of_one(self, own: SizeRecord, other: SizeRecord) -> Array:
        """(C,) log evidence of the views of two objects as of one size, relative to that as of two.

        Integral of the product of both Gaussians over the size, divided by the prior: by Bayes' rule. Where outliers
        have left a variance above the prior's, the quotient counts as no wider than the prior.
        """
        precision = 1.0 / own.variance + 1.0 / other.variance
        weighted = own.mean / own.variance + other.mean / other.variance
        beyond = np.maximum(precision - 1.0 / self.variances, 1.0 / self.variances)
        mean = (weighted - self.means / self.variances) / beyond
        both = _log_normal(own.mean - other.mean, own.variance + other.variance)
        return both - _log_normal(mean - self.means, self.variances + 1.0 / beyond)

    def _log_parts(
        self, means: Array, variances: Array, log_size: Array | float, variance: Array | float
    ) -> tuple[Array, Array]:
        """(...,) log joint densities of views as inliers, and as outliers."""
        inlier = _log_normal(log_size - means, variances + self.view_variance + variance)
        return inlier + np.log1p(-self.outlier_share), log_density_of_any(log_size, variance) + np.log(
            self.outlier_share
        )


def log_density_of_any(log_size: Array | float, variance: Array | float) -> Array:
    """(...,) log densities of log sizes [m] of things of any size, measured with ``variance``."""
    return _log_normal(log_size - MEAN_OF_ANY, SIGMA_OF_ANY**2 + variance)


def _log_normal(off: Array | float, variance: Array | float) -> Array:
    return np.asarray(-0.5 * (off**2 / variance + np.log(variance) + LOG_2PI))
