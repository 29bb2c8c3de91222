"""Sizes that boxes show, against closed forms."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from semantic_slam.viewpoint.size_model import MEAN_OF_ANY, SIGMA_OF_ANY, SizeModel

SIGMA, SIGMA_VIEW = 0.5, 0.3


def model(share: float = 0.05) -> SizeModel:
    return SizeModel.of(("cup", "TV", "thing"), {"cup": 0.1, "tv": 0.5}, SIGMA, SIGMA_VIEW, share)


def told(own: SizeModel, sizes: list[float], variance: float = 0.0) -> np.ndarray:
    record = own.start()
    for size in sizes:
        record = own.after(record, float(np.log(size)), variance)
    return record.log_likelihood


def test_views_of_one_object_share_its_size() -> None:
    sizes = np.array([0.12, 0.09, 0.2, 0.11])
    means, sigmas = [np.log(0.1), np.log(0.5), MEAN_OF_ANY], [SIGMA, SIGMA, SIGMA_OF_ANY]
    together = [
        multivariate_normal.logpdf(np.log(sizes), np.full(4, mean), SIGMA_VIEW**2 * np.eye(4) + sigma**2)
        for mean, sigma in zip(means, sigmas, strict=True)
    ]
    np.testing.assert_allclose(told(model(1e-12), sizes.tolist()), together, rtol=1e-6)


def test_a_size_tells_classes_apart_and_more_views_of_it_hardly_more() -> None:
    by_one, by_many = told(model(), [0.1]), told(model(), [0.1] * 30)
    assert by_one[0] - by_one[1] > 2.0
    assert by_many[0] - by_many[1] < 8.0  # half as large again: things of one name differ, however often one is seen


def test_a_box_of_an_object_that_is_known_to_be_small_is_hardly_a_large_one() -> None:
    own = model()
    record = own.start()
    for _ in range(5):
        record = own.after(record, np.log(0.1), 0.0)
    shown = np.log([0.1, 0.5])
    alike, larger = own.log_densities(record.mean, record.variance, shown[:, None], np.zeros(1))
    assert (alike - larger > 2.0).all()


def test_an_outlier_moves_nothing() -> None:
    own = model()
    record = own.start()
    for _ in range(10):
        record = own.after(record, np.log(0.1), 0.0)
    after = own.after(record, np.log(1.5), 0.0)
    np.testing.assert_allclose(after.mean[0], record.mean[0], atol=0.01)


def test_where_ranges_are_not_known_sizes_tell_little() -> None:
    known, unknown = told(model(), [0.1]), told(model(), [0.1], variance=1.0)
    assert unknown[0] - unknown[1] < 0.5 * (known[0] - known[1])


@pytest.mark.parametrize("size", [0.01, 10.0])
def test_what_no_class_is_as_large_as_costs_no_more_than_an_outlier(size: float) -> None:
    outlier = np.log(0.05) - 0.5 * ((np.log(size) - MEAN_OF_ANY) ** 2 + np.log(2.0 * np.pi))
    assert (told(model(), [size]) >= outlier - 1e-9).all()


def test_two_objects_as_one_weigh_what_all_their_views_of_one_do() -> None:
    """Relative to two; exact without outliers."""
    own, some, others = model(1e-12), [0.12, 0.09], [0.2, 0.11, 0.15]
    one, two = own.start(), own.start()
    for size in some:
        one = own.after(one, float(np.log(size)), 0.01)
    for size in others:
        two = own.after(two, float(np.log(size)), 0.01)
    exact = told(own, some + others, 0.01) - one.log_likelihood - two.log_likelihood
    np.testing.assert_allclose(own.log_of_one(one, two), exact, atol=1e-6)
    assert exact[0] > 0.0  # alike in size
