"""Vectors of appearance: what views tell of whether they show one object is the density of a Gaussian, exactly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground, SeenVectors
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam.viewpoint.embeddings.model import NUM_SECTORS, EmbeddingModel, EmbeddingRecord
from semantic_slam.viewpoint.embeddings.vectors import reduced

SIZE = 6
MODEL = EmbeddingModel(
    dimensions=SIZE, spread_shares=(0.05, 0.3), noise_shares=(0.02, 0.1), repeat_rad=0.5, outlier_share=0.05
)
EXACT = replace(MODEL, spread_shares=(0.3,), noise_shares=(0.1,), outlier_share=0.0)
EVEN = np.zeros(1)
"""Log prior of its only setting."""
BACKGROUND = EmbeddingBackground(centre=np.full(SIZE, 0.1), spread=0.9, dimensions=float(SIZE))
View = tuple[np.ndarray, *tuple[float, ...]]  # vector, azimuth, log of the distance and, in space, elevation


def drawn(count: int, seed: int = 0, *, in_space: bool = False) -> list[View]:
    random = np.random.default_rng(seed)
    views = [(random.normal(0.1, 0.4, SIZE), random.uniform(-np.pi, np.pi), random.normal()) for _ in range(count)]
    return [(*view, random.uniform(-0.5 * np.pi, 0.5 * np.pi)) for view in views] if in_space else views


def ratio(record: EmbeddingRecord, view: View, background: EmbeddingBackground = BACKGROUND) -> np.ndarray:
    return record.log_ratios(view[0], background, CameraPlaces.one(*view[1:]))[:, 0]


def seen(model: EmbeddingModel, views: list[View], **start: object) -> tuple[float, EmbeddingRecord]:
    """Evidence of all views, and the record after them."""
    record, total, usual = model.start(**start), 0.0, model.usual(np.zeros(len(model.settings[0])))
    for view in views:
        found = ratio(record, view)
        total += model.evidence(record, found, usual)
        record = record.after(view[0], found, usual, BACKGROUND, CameraPlaces.one(*view[1:]))
    return total, record


def exact(views: list[View]) -> float:
    """Log density of the views of one object under EXACT's Gaussian, relative to the background's."""
    s, n, r = 0.3, 0.1, EXACT.repeat_rad
    angles, away, up = np.array([(*view[1:], 0.0)[:3] for view in views]).T
    sight = np.stack([np.cos(up) * np.cos(angles), np.cos(up) * np.sin(angles), np.sin(up)], axis=1)
    log_kernel = (sight @ sight.T - 1 - 0.5 * (away[:, None] - away) ** 2) / r**2
    covariance = (1 - s - n) + s * np.exp(log_kernel) + n * np.eye(len(views))
    scale, total = BACKGROUND.spread / SIZE, 0.0
    for component in np.array([view[0] for view in views]).T - 0.1:
        total += multivariate_normal(np.zeros(len(views)), scale * covariance).logpdf(component)
        total -= multivariate_normal(0.0, scale).logpdf(component).sum()
    return float(total)


def test_the_first_view_of_an_object_is_as_likely_as_the_background():
    total, _ = seen(MODEL, drawn(1))
    assert total == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("in_space", [False, True])
def test_views_one_after_the_other_have_the_density_of_all_at_once(in_space):
    views = drawn(5, in_space=in_space)
    total, _ = seen(EXACT, views)
    assert total == pytest.approx(exact(views))


def test_the_order_of_views_does_not_matter():
    views = drawn(5)
    assert seen(EXACT, views)[0] == pytest.approx(seen(EXACT, views[::-1])[0])


def test_the_predictive_density_integrates_to_one():
    """Over the background, by samples of which the ratio is the weight."""
    _, record = seen(EXACT, drawn(3))
    random = np.random.default_rng(1)
    draws = random.normal(0.1, np.sqrt(BACKGROUND.spread / SIZE), (40_000, SIZE))
    weights = np.exp([ratio(record, (draw, 0.3, 0.0))[0] for draw in draws[:4000]])
    assert weights.mean() == pytest.approx(1.0, abs=4.0 * weights.std() / np.sqrt(len(weights)))


def test_from_wherever_a_view_may_be_its_variance_is_positive():
    """Also where it is not known from how far."""
    _, record = seen(MODEL, drawn(12))
    directions = np.linspace(-np.pi, np.pi, 24)
    found = record.log_ratios(drawn(1, 5)[0][0], BACKGROUND, record.usual_places(directions))
    assert found.shape == (4, 24) and np.isfinite(found).all()


def test_a_view_from_the_same_place_tells_less_than_one_from_elsewhere():
    """Of the mean direction: near-identical views repeat themselves."""
    vector = np.full(SIZE, 0.4)
    near = seen(EXACT, [(vector, 0.0, 0.0), (vector, 0.3, 0.0)])[1]
    far = seen(EXACT, [(vector, 0.0, 0.0), (vector, np.pi, 0.0)])[1]
    assert far.mean_direction(EVEN)[1] < near.mean_direction(EVEN)[1]


def test_the_mean_direction_is_that_of_the_settings_which_other_objects_told():
    """One view tells nothing of an object's own setting; forty objects before it have."""
    told = np.zeros(4)
    told[0] = 1e6
    ((vector, azimuth, _),) = drawn(1)
    place = CameraPlaces.one(azimuth, 0.0)
    spread, noise = (float(own[0]) for own in MODEL.settings)
    alone = replace(MODEL, spread_shares=(spread,), noise_shares=(noise,))
    means = []
    for model, usual in ((MODEL, MODEL.usual(told)), (alone, np.zeros(1))):
        record = model.start()
        ratios = record.log_ratios(vector, BACKGROUND, place)[:, 0]
        means.append(record.after(vector, ratios, usual, BACKGROUND, place).mean_direction(usual))
    np.testing.assert_allclose(means[0][0], means[1][0], atol=1e-5)
    assert means[0][1] == pytest.approx(means[1][1], rel=1e-4)


def test_the_mean_direction_is_the_conjugate_posterior_of_independent_views():
    model = replace(EXACT, repeat_rad=1e-3)
    views = [(own[0], angle, 0.0) for own, angle in zip(drawn(3), (-2.0, 0.0, 2.0), strict=True)]
    mean, spread = seen(model, views)[1].mean_direction(EVEN)
    precision = 1 / 0.6 + 3 / 0.4
    average = np.mean([view[0] for view in views], axis=0)
    np.testing.assert_allclose(mean, 0.1 + (3 / 0.4) / precision * (average - 0.1))
    assert spread == pytest.approx(BACKGROUND.spread / precision)


def test_no_single_view_decides_everything():
    look = drawn(1)[0][0]
    same = [(look, angle, 0.0) for angle in (0.0, 1.0, 2.0)]
    _, record = seen(MODEL, same)
    usual = MODEL.usual(np.zeros(4))
    strange = ratio(record, (-20.0 * look, 3.0, 0.0))
    assert MODEL.evidence(record, strange, usual) == pytest.approx(np.log(MODEL.outlier_share), abs=1e-6)
    after = record.after(-20.0 * look, strange, usual, BACKGROUND, CameraPlaces.one(3.0, 0.0))
    assert len(after.vectors) == len(record.vectors) and after.num_views == 4


def test_what_spreads_are_usual_is_learned_from_other_objects():
    random = np.random.default_rng(3)
    steady = [seen(MODEL, [(look + random.normal(0, 0.02, SIZE), a, 0.0) for a in range(5)])[1] for look in _looks(8)]
    shared = MODEL.usual(np.sum([record.told_settings for record in steady], axis=0))
    few = MODEL.settings[0] == 0.05
    assert np.exp(shared)[few].sum() > 0.9
    assert np.exp(MODEL.usual(np.zeros(4)))[few].sum() == pytest.approx(0.5)


def _looks(count: int) -> np.ndarray:
    return np.random.default_rng(2).normal(0.1, 0.4, (count, SIZE))


def test_what_a_map_knows_of_an_object_is_its_prior():
    """Known exactly, the first view has the density of the object's own spread."""
    view, mean = drawn(1)[0], np.full(SIZE, 0.3)
    total, _ = seen(EXACT, [view], mean=mean, spread=0.0)
    scale = BACKGROUND.spread / SIZE
    own = multivariate_normal(mean, 0.4 * scale * np.eye(SIZE)).logpdf(view[0])
    assert total == pytest.approx(own - multivariate_normal(BACKGROUND.centre, scale * np.eye(SIZE)).logpdf(view[0]))


def test_of_each_sector_the_newest_view_is_remembered():
    views = [(vector, 2 * np.pi * k / NUM_SECTORS / 2, 0.0) for k, (vector, _, _) in enumerate(drawn(4 * NUM_SECTORS))]
    _, record = seen(EXACT, views)
    assert len(record.vectors) == NUM_SECTORS and record.num_views == 4 * NUM_SECTORS
    assert record.vectors[-1] is views[-1][0]


def test_from_two_heights_of_a_sector_both_views_are_remembered():
    """One from above is no repetition of one from the side."""
    level, above, again = (view[0] for view in drawn(3))
    _, record = seen(EXACT, [(level, 1.0, 0.0, 0.0), (above, 1.0, 0.0, 1.0), (again, 1.0, 0.0, 0.05)])
    assert len(record.vectors) == 2 and record.vectors[0] is above and record.vectors[1] is again
    places = record.usual_places(np.array([1.0, 2.0]))
    np.testing.assert_array_equal(places.azimuths_rad, [1.0, 2.0])
    np.testing.assert_array_equal(places.elevations_rad, [1.0, 1.0])


def test_the_background_of_many_vectors_has_their_moments():
    random = np.random.default_rng(0)
    scales = np.repeat([0.3, 0.2, 0.05], [10, 20, 30])
    vectors = 0.2 + random.normal(size=(2000, 60)) * scales
    found = SeenVectors.none(60).with_vectors(vectors[:100]).with_vectors(vectors[100:])
    assert len(found.distinct) > 500  # of so many dimensions hardly any two are alike
    np.testing.assert_allclose(found.background.centre, 0.2, atol=0.03)
    assert found.background.spread == pytest.approx((scales**2).sum(), rel=0.2)  # distinct ones lie farther out
    assert found.background.dimensions == pytest.approx((scales**2).sum() ** 2 / (scales**4).sum(), rel=0.1)


def test_to_look_at_one_thing_for_long_is_not_to_see_more():
    random = np.random.default_rng(0)
    looks = reduced(random.normal(size=(4, 40)), 40)
    once = SeenVectors.none(40).with_vectors(looks)
    often = once.with_vectors(looks[0] + random.normal(0.0, 0.02, (200, 40)))
    assert len(often.distinct) == 4 and often.count == 204
    np.testing.assert_array_equal(often.background.centre, once.background.centre)


def test_dimensions_are_not_estimated_from_few_vectors():
    few = SeenVectors.none(4).with_vectors(np.eye(4)[:2])
    assert few.background.dimensions == SeenVectors.none(4).background.dimensions == 16.0


def test_rows_without_a_vector_are_not_counted():
    seen_vectors = SeenVectors.none(2).with_vectors(np.array([[1.0, 0.0], [np.nan, np.nan]]))
    assert seen_vectors.count == 1


def test_only_the_direction_of_a_vector_counts():
    vectors = np.random.default_rng(0).normal(size=(3, 5))
    np.testing.assert_allclose(reduced(vectors, 8), reduced(vectors * [[1e-3], [1e200], [7.0]], 8))
    np.testing.assert_allclose(np.linalg.norm(reduced(vectors, 8), axis=1), 1.0)


def test_a_projection_keeps_inner_products_about():
    vectors = np.random.default_rng(0).normal(size=(200, 1024))
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    off = reduced(vectors, 128) @ reduced(vectors, 128).T - unit @ unit.T
    assert abs(off.mean()) < 0.002 and off.std() < 1.1 / np.sqrt(128)


@pytest.mark.parametrize("row", [[0.0, 0.0], [np.nan, 1.0], [np.inf, 1.0]])
def test_what_has_no_direction_is_no_vector(row):
    found = reduced(np.array([row, [3.0, 4.0]]), 2)
    assert np.isnan(found[0]).all()
    np.testing.assert_allclose(found[1], [0.6, 0.8])
