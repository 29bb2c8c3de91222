"""Importance sampling with as few points as there are Gaussians to draw from."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.importance import Gaussians, draw, weighed
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

LOG_EVIDENCE = -3.0
MEANS = np.array([[2.0, 0.0], [-1.0, 1.0], [0.0, -2.0], [4.0, 4.0], [0.0, 0.0]])


@dataclass(frozen=True)
class _EvenMixture:
    """An integrand of known integral: unit Gaussians about all means, with equal shares, relative to the prior."""

    def log_target(self, y: Array) -> Array:
        density = np.mean([multivariate_normal(mean, np.eye(2)).pdf(y) for mean in MEANS], axis=0)
        size = y.shape[1]
        return np.asarray(LOG_EVIDENCE + np.log(density) + 0.5 * (y**2).sum(axis=1) + 0.5 * size * np.log(2.0 * np.pi))


@pytest.mark.parametrize("shares", [[0.3, 0.3, 0.2, 0.1, 0.1], [0.6, 0.1, 0.1, 0.1, 0.1], [0.2] * 5])
def test_a_pair_of_each_gaussian_has_the_integral_of_their_even_mixture(shares: list[float]) -> None:
    """Five pairs for five Gaussians can only be one of each, and their even mixture is sampled without error."""
    mixture = Gaussians(MEANS, np.broadcast_to(np.eye(2), (5, 2, 2)), np.log(shares))
    samples = weighed(draw(_EvenMixture(), [mixture], 2 * len(MEANS)))
    assert samples.y.shape == (2 * len(MEANS), 2)
    np.testing.assert_allclose(samples.log_weights, LOG_EVIDENCE, atol=1e-12)


def _lost_among_look_alikes(num_samples: int) -> HybridBelief:
    """The belief of a robot that sees one of four alike objects in three keyframes, and may stand nearly anywhere."""
    places = [(3.0, 1.0), (3.0, -1.0), (0.0, 3.0), (-3.0, 0.0)]
    known = MapPrior(tuple(ObjectPrior.planar(n, *at, sigma_m=0.05, sigma_rad=3.0) for n, at in enumerate(places)))
    configuration = Configuration.of(semantic_model={"kind": "parametric"}, weights={"importance_samples": num_samples})
    spread = np.diag([3.0, 3.0, 2.0]) ** 2
    engine = Engine(configuration, known, initial_pose=np.zeros(3), initial_covariance=spread)
    seen = [Detection(range_m=2.0, bearing_rad=0.1, class_scores={"class_1": 0.7, "class_2": 0.3})]
    for k in range(3):
        moved = (0.3, 0.0, 0.1) if k else (0.0, 0.0, 0.0)
        belief = engine.process(Keyframe.planar(k, motion=moved, detections=seen, motion_sigmas=(0.02, 0.02, 0.01)))
    return belief


@pytest.mark.parametrize("num_samples", [16, 32])
def test_a_lost_robot_gets_along_with_the_fewest_samples(num_samples: int) -> None:
    """Its candidates have up to four modes, of which the first quarter of the samples has points, too."""
    belief = _lost_among_look_alikes(num_samples)
    assert np.isfinite(belief.log_evidence) and np.exp(belief.log_weights).sum() == pytest.approx(1.0)
