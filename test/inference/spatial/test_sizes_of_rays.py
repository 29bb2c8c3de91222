"""Boxes without depth: where a thing is and what it is, by labels, sizes and rays together, against an integral."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.models.spatial.log_range import LogRange
from semantic_slam.viewpoint.size_model import MEAN_OF_ANY, SIGMA_OF_ANY

CAMERA = (0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5)
"""At the body's origin, ahead."""
RAY_SIGMA, SIGMA, SIGMA_VIEW, STEP_M = 0.01, 0.5, 0.3, 0.1
SIZES = {"cup": 0.1, "chair": 0.7}
LEAST_M, MOST_M = 0.3, 5.0
PRIORS = [*[(np.log(size), SIGMA) for size in SIZES.values()], (MEAN_OF_ANY, SIGMA_OF_ANY)]


def walked(
    labels: list[str], range_m: float, size_m: float, sigma_view: float, sigma_start_m: float = 1e-3
) -> list[tuple[int, np.ndarray]]:
    """Number of objects and class probabilities of the first, while a camera walks aside past one thing ahead."""
    configuration = Configuration.of(
        state_space="spatial",
        observation="points",
        association="open",
        semantic_model={"kind": "detector", "labels": list(SIZES), "outlier_share": 0.02},
        open_world={"iterate_updates": True, "min_range_m": LEAST_M, "max_range_m": MOST_M, "clutter_per_frame": 1e-6},
        new_objects={
            "size_by_label": [f"{label}={size}" for label, size in SIZES.items()],
            "sigma_log_size": SIGMA,
            "sigma_log_view": sigma_view,
        },
    )
    start = np.diag([sigma_start_m] * 3 + [1e-3] * 3) ** 2
    engine = Engine(configuration, initial_pose=(0, 0, 0, 0, 0, 0, 1), initial_covariance=start)
    found = []
    for index, label in enumerate(labels):
        aside = -STEP_M * index
        angle = 2.0 * np.arctan(0.5 * size_m / np.hypot(range_m, aside))
        seen = Detection.along(
            [-aside, 0.0, range_m],
            ray_covariance=RAY_SIGMA**2 * np.eye(3),
            T_body_sensor=CAMERA,
            label=label,
            score=0.9,
            angular_size_rad=(angle, angle),
        )
        step = {"motion": (0, STEP_M, 0, 0, 0, 0, 1), "motion_covariance": 1e-8 * np.eye(6)} if index else {}
        belief = engine.process(Keyframe.spatial(index, detections=[seen], T_body_camera=CAMERA, **step))
        found.append((len(belief.class_probabilities), belief.class_probabilities[0]))
    return found


def by_sizes(count: int, range_m: float, size_m: float) -> np.ndarray:
    """(C,) log evidence of ``count`` boxes and rays under each class, over the range of an object on the first ray."""
    prior = LogRange.between(LEAST_M, MOST_M)
    log_range = prior.mean + prior.sigma * np.linspace(-6.0, 6.0, 4001)
    log_prior = norm.logpdf(log_range, prior.mean, prior.sigma)
    ahead, aside = np.exp(log_range), -STEP_M * np.arange(count)[:, None]
    off = np.arctan2(aside, ahead) - np.arctan2(aside, range_m)
    log_geometry = norm.logpdf(off[1:], scale=RAY_SIGMA).sum(axis=0)
    told = np.log(size_m / np.hypot(range_m, aside) * np.hypot(ahead, aside))  # (count, N) sizes that the boxes show
    shared = np.ones((count, count))
    densities = [
        multivariate_normal.logpdf(told.T, np.full(count, mean), sigma**2 * shared + SIGMA_VIEW**2 * np.eye(count))
        for mean, sigma in PRIORS
    ]
    return np.logaddexp.reduce(log_prior + log_geometry + np.array(densities), axis=1)


@pytest.mark.parametrize(
    ("labels", "range_m", "size_m"),
    [(["chair", "cup", "cup", "cup"], 1.0, 0.1), (["cup", "chair", "chair", "chair", "chair"], 3.0, 0.7)],
)
def test_a_wrong_first_label_makes_no_second_object_and_the_class_recovers(
    labels: list[str], range_m: float, size_m: float
) -> None:
    number, sized = walked(labels, range_m, size_m, SIGMA_VIEW)[-1]
    _, words = walked(labels, range_m, size_m, 0.0)[-1]
    expected = np.log(words) + by_sizes(len(labels), range_m, size_m)
    assert number == 1
    np.testing.assert_allclose(sized, np.exp(expected - np.logaddexp.reduce(expected)), atol=0.08)


@pytest.mark.parametrize("label", ["chair", "cup"])
@pytest.mark.parametrize(("range_m", "size_m"), [(1.0, 0.1), (2.0, 0.7), (3.0, 0.7)])
def test_the_first_box_tells_a_class_as_little_as_its_unknown_range_allows(
    label: str, range_m: float, size_m: float
) -> None:
    """The range that its label lets expect is no evidence that the label is right."""
    (_, sized), *_ = walked([label], range_m, size_m, SIGMA_VIEW)
    (_, words), *_ = walked([label], range_m, size_m, 0.0)
    expected = np.log(words) + by_sizes(1, range_m, size_m)
    np.testing.assert_allclose(sized, np.exp(expected - np.logaddexp.reduce(expected)), atol=0.01)


def test_where_the_map_lies_does_not_count_for_the_size_of_what_is_seen() -> None:
    """Its range is known relative to the camera, however uncertain both are in map."""
    labels, thing = ["cup"] * 3, (1.0, 0.1)
    (_, found), (_, expected) = (walked(labels, *thing, SIGMA_VIEW, sigma)[-1] for sigma in (0.5, 1e-3))
    odds, expected_odds = (np.log(own[:2] / own[2]) for own in (found, expected))
    np.testing.assert_allclose(odds, expected_odds, atol=0.8)
