"""Quantiles of the chi-squared distribution are those of scipy.stats, bit by bit."""

import numpy as np
from scipy.stats import chi2

from semantic_slam.geometry.chi_squared import chi_squared_quantile


def test_quantiles_are_those_of_scipy() -> None:
    shares, degrees = np.linspace(0.0, 1.0, 21)[:, None], np.array([0.5, 1.0, 2.0, 7.0, 60.0, np.nan])
    np.testing.assert_array_equal(chi_squared_quantile(shares, degrees), chi2.ppf(shares, degrees))
