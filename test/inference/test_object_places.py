"""Objects that are in one of several places: what a belief tells of them, against the mixture itself."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from worlds.belief_factory import small_belief

from semantic_slam.answers.region import inside
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.object_places import MOST_PLACES, distinct_places
from semantic_slam.inference.object_table import ObjectTable, marginals, without_views
from semantic_slam.messages.codec import decode, encode


def table(positions: np.ndarray, sigmas: np.ndarray, existence: np.ndarray) -> ObjectTable:
    """(H, O, 2) positions with (H, O) standard deviations; NaN: not in that hypothesis."""
    hypotheses, objects = sigmas.shape
    planar = np.concatenate([positions, np.zeros((hypotheses, objects, 1))], axis=-1)
    covariances = sigmas[..., None, None] ** 2 * np.eye(3)
    return without_views(
        hypotheses,
        np.zeros((objects, 0)),
        object_poses=np.where(np.isnan(sigmas)[..., None], np.nan, pose_vector_from_planar(np.nan_to_num(planar))),
        object_covariances=np.where(
            np.isnan(sigmas)[..., None, None], np.nan, covariance_from_planar(np.nan_to_num(covariances))
        ),
        existence=existence,
    )


def belief_of(weights: np.ndarray, objects: ObjectTable) -> HybridBelief:
    hypotheses, count = objects.object_poses.shape[:2]
    plain = small_belief(0, range(1, hypotheses + 1), [0] * hypotheses, weights, range(count), [[]] * hypotheses, ())
    told = {name: getattr(plain, name) for name in vars(plain)}
    mixed = marginals(weights, objects)
    told |= {name: mixed[name] for name in ("object_poses", "object_covariances", "existence")}
    return HybridBelief(**told | distinct_places(weights, objects))


def share_inside(weights, objects: ObjectTable, row: int, region: tuple[float, ...]) -> float:
    """Probability that an object is in a region if it exists, hypothesis by hypothesis."""
    total = inside_all = 0.0
    for number, weight in enumerate(weights):
        mean, spread = objects.object_poses[number, row, :2], objects.object_covariances[number, row, :2, :2]
        if np.isfinite(mean).all():
            weight = weight * objects.existence[number, row]
            total += weight
            inside_all += weight * multivariate_normal(mean, spread).cdf(region[2:], lower_limit=region[:2])
    return inside_all / total


def test_an_object_on_either_of_two_sides_is_on_one_with_half_and_between_them_with_nothing() -> None:
    weights = np.array([0.5, 0.5])
    objects = table(np.array([[[0.0, 1.2]], [[0.0, -1.2]]]), np.full((2, 1), 0.1), np.ones((2, 1)))
    belief = belief_of(weights, objects)
    np.testing.assert_allclose(inside(belief, (-0.4, 0.8, 0.4, 1.6)), 0.5, atol=1e-3)
    np.testing.assert_allclose(inside(belief, (-0.5, -0.5, 0.5, 0.5)), 0.0, atol=1e-6)
    (known,) = belief.objects
    assert [place.probability for place in known.places] == [0.5, 0.5]
    np.testing.assert_allclose([place.position[:2] for place in known.places], [[0.0, 1.2], [0.0, -1.2]])


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_what_some_hypotheses_know_is_not_blurred_by_those_that_do_not(share: float) -> None:
    """An object of which one hypothesis knows the place, and the other only that it is somewhere about."""
    weights = np.array([1.0 - share, share])
    objects = table(np.array([[[1.0, 0.5]], [[0.0, 0.0]]]), np.array([[0.05], [3.0]]), np.ones((2, 1)))
    belief = belief_of(weights, objects)
    for region in ((0.8, 0.3, 1.2, 0.7), (-4.0, -4.0, 0.7, 4.0)):
        np.testing.assert_allclose(inside(belief, region), share_inside(weights, objects, 0, region), atol=1e-3)


def test_where_hypotheses_agree_there_is_one_place() -> None:
    objects = table(np.array([[[0.0, 0.05]], [[0.0, -0.05]]]), np.full((2, 1), 0.1), np.ones((2, 1)))
    belief = belief_of(np.array([0.7, 0.3]), objects)
    assert not len(belief.place_objects)
    (place,) = belief.objects[0].places
    np.testing.assert_array_equal(place.position, belief.object_poses[0, :3])
    assert place.probability == 1.0


def test_random_mixtures_are_told_within_a_hundredth_mostly_and_six_at_worst() -> None:
    """Twelve hypotheses of four places or fewer for five objects, some of which they lack or doubt.

    Hypotheses that share a place may know it to 0.1 m or to 0.4 m; one Gaussian for both is the largest error.
    """
    errors = []
    for seed in range(8):
        random = np.random.default_rng(seed)
        weights = random.dirichlet(np.ones(12))
        sides = random.uniform(-3.0, 3.0, (4, 5, 2))[random.integers(0, 4, (12, 5)), np.arange(5)]
        sigmas = np.where(random.random((12, 5)) < 0.2, np.nan, random.uniform(0.1, 0.4, (12, 5)))
        sigmas[0] = 0.2
        objects = table(sides + random.normal(0.0, 0.05, sides.shape), sigmas, random.uniform(0.3, 1.0, (12, 5)))
        belief = belief_of(weights, objects)
        for region in ((-1.0, -1.0, 1.0, 1.0), (0.0, -3.0, 3.0, 3.0), (-2.0, 0.0, 0.5, 2.0)):
            expected = [share_inside(weights, objects, row, region) for row in range(5)]
            errors.append(np.abs(inside(belief, region) - expected))
        for row in set(belief.place_objects.tolist()):
            assert belief.place_probabilities[belief.place_objects == row].sum() == pytest.approx(1.0)
    assert np.max(errors) < 0.06 and np.quantile(errors, 0.9) < 0.01


def test_places_have_together_the_moments_of_the_mixture() -> None:
    random = np.random.default_rng(0)
    weights = random.dirichlet(np.ones(30))
    objects = table(random.uniform(-5.0, 5.0, (30, 1, 2)), np.full((30, 1), 0.1), np.ones((30, 1)))
    belief = belief_of(weights, objects)
    assert len(belief.place_objects) == MOST_PLACES
    shares, means = belief.place_probabilities, belief.place_means
    mean = shares @ means
    spread = np.einsum(
        "m,mij->ij", shares, belief.place_covariances + (means - mean)[:, :, None] * (means - mean)[:, None]
    )
    np.testing.assert_allclose(mean, belief.object_poses[0, :3], atol=1e-9)
    np.testing.assert_allclose(spread, belief.object_covariances[0, :3, :3], atol=1e-8)


def test_places_are_in_messages() -> None:
    objects = table(np.array([[[0.0, 1.0]], [[2.0, -1.0]]]), np.full((2, 1), 0.1), np.ones((2, 1)))
    belief = belief_of(np.array([0.6, 0.4]), objects)
    again = decode(encode(belief), "semantic_slam_msgs/msg/HybridBelief")
    for name in ("place_objects", "place_probabilities", "place_means", "place_covariances"):
        np.testing.assert_array_equal(getattr(again, name), getattr(belief, name))
    assert again.place_means.shape == (2, 3)
