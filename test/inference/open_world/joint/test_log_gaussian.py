"""Log densities of residuals, against SciPy's."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from semantic_slam.inference.open_world.joint.log_gaussian import log_gaussian, log_gaussian_of_many


@pytest.mark.parametrize("log_density", [log_gaussian, log_gaussian_of_many])
def test_a_log_density_is_the_normal_one_but_for_its_constant_and_not_measured_components_count_nothing(
    log_density: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> None:
    generator = np.random.default_rng(3)
    residual, root = generator.normal(size=(4, 2)), generator.normal(size=(4, 2, 2))
    covariance = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(2)
    expected = [
        multivariate_normal(cov=own).logpdf(off) + np.log(2.0 * np.pi)
        for off, own in zip(residual, covariance, strict=True)
    ]
    np.testing.assert_allclose(log_density(residual, covariance), expected, rtol=1e-12)
    padded = np.zeros((4, 3, 3)) + np.eye(3)
    padded[:, :2, :2] = covariance
    with_none = np.concatenate([residual, np.zeros((4, 1))], axis=1)
    np.testing.assert_allclose(log_density(with_none, padded), expected, rtol=1e-12)
