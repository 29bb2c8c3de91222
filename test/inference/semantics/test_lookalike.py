"""Descriptors seen from unknown directions, and the query for what looks like a crop."""

import numpy as np
import pytest
from worlds.views.harmonic_model import HarmonicModel

from semantic_slam.inference.lookalike import lookalikes
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.semantics.descriptors.heading_update import DirectionalView, updated_mixtures
from semantic_slam.inference.states.heading_mixture import HeadingMixture
from semantic_slam.latent.model import DescriptorBelief
from semantic_slam.viewpoint.model import Viewpoints

MODEL = HarmonicModel()
TRUE = np.array([0.8, -0.5, 0.3])


def view(model: HarmonicModel, azimuth: float, descriptor: np.ndarray = TRUE, seed: int = 0) -> PlanarDetection:
    mean = model.predict(Viewpoints(np.array([azimuth]), np.zeros(1), np.ones(1)), descriptor[None]).mean[0]
    feature = mean + model.noise * np.random.default_rng(seed).normal(size=len(mean))
    size = len(feature)
    return PlanarDetection(
        range_m=2.0,
        bearing_rad=0.0,
        covariance=0.01 * np.eye(2),
        sensor=np.zeros(2),
        feature=feature,
        feature_covariance=np.zeros((size, size)),
    )


def exact(model: HarmonicModel, detection: PlanarDetection, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log evidence of each azimuth, and the descriptor there: e is linear, N(0, I) before."""
    part = model.predict(Viewpoints(angles, np.zeros_like(angles), np.ones_like(angles)), np.zeros((len(angles), 3)))
    transposed = np.swapaxes(part.by_descriptor, 1, 2)
    covariance = part.by_descriptor @ transposed + model.noise**2 * np.eye(model.num_features)
    residual = detection.feature - part.mean
    solved = np.linalg.solve(covariance, residual[..., None])
    log = -0.5 * ((residual * solved[..., 0]).sum(-1) + np.linalg.slogdet(2 * np.pi * covariance)[1])
    return log, (transposed @ solved)[..., 0]


@pytest.mark.parametrize("seed", range(4))
def test_evidence_over_the_circle_is_the_integral(seed: int) -> None:
    detection = view(MODEL, 0.9, seed=seed)
    start = HeadingMixture.all_around(MODEL.prior)
    ((_, evidence),) = updated_mixtures(
        LatentObservation(MODEL),
        DetectionFeatures.of([detection]),
        [DirectionalView(modes=start, view=0, bearing_rad=0.0, sigma_rad=0.0)],
    )
    logs, _ = exact(MODEL, detection, np.arange(0.0, 2 * np.pi, np.pi / 720))
    assert evidence == pytest.approx(np.logaddexp.reduce(logs) - np.log(len(logs)), abs=0.3)


def test_views_from_several_sides_settle_heading_and_descriptor() -> None:
    """Heading 0.5; views at bearings b are seen from azimuth b - 0.5."""
    modes, heading = HeadingMixture.all_around(MODEL.prior), 0.5
    for number, bearing in enumerate(np.linspace(0.0, 2.0, 6)):
        seen = DetectionFeatures.of([view(MODEL, bearing - heading, seed=number)])
        ((modes, _),) = updated_mixtures(
            LatentObservation(MODEL),
            seen,
            [DirectionalView(modes=modes, view=0, bearing_rad=float(bearing), sigma_rad=0.02)],
        )
    mean, covariance, share = modes.best()
    assert share > 0.99
    deviation = (mean - np.append(TRUE, heading)) / np.sqrt(np.diag(covariance))
    assert np.abs(deviation).max() < 4.0
    assert abs(mean[-1] - heading) < 0.1
    np.testing.assert_allclose(modes.descriptor()[0], mean[:3], atol=0.02)


def test_a_symmetric_object_keeps_two_headings() -> None:
    model = HarmonicModel(symmetric=True)
    modes = HeadingMixture.all_around(model.prior)
    for number, bearing in enumerate(np.linspace(0.0, 2.0, 5)):
        seen = DetectionFeatures.of([view(model, bearing - 0.5, seed=number)])
        ((modes, _),) = updated_mixtures(
            LatentObservation(model),
            seen,
            [DirectionalView(modes=modes, view=0, bearing_rad=float(bearing), sigma_rad=0.02)],
        )
    mean, _, share = modes.best()
    assert share == pytest.approx(0.5, abs=0.02)
    assert min(abs(mean[-1] - 0.5), abs(abs(mean[-1] - 0.5) - np.pi)) < 0.1


def test_the_batch_is_its_rows() -> None:
    detections = DetectionFeatures.of([view(MODEL, 0.3), view(MODEL, 2.0, seed=1)])
    modes = HeadingMixture.all_around(MODEL.prior)
    sightings = [
        DirectionalView(modes=modes, view=0, bearing_rad=0.1, sigma_rad=0.05),
        DirectionalView(modes=modes, view=1, bearing_rad=1.0, sigma_rad=0.0),
    ]
    together = updated_mixtures(LatentObservation(MODEL), detections, sightings)
    for item, (after, evidence) in zip(sightings, together, strict=True):
        ((alone, own),) = updated_mixtures(LatentObservation(MODEL), detections, [item])
        assert own == pytest.approx(evidence, abs=1e-9)
        np.testing.assert_allclose(alone.mean, after.mean, atol=1e-9)
    assert updated_mixtures(LatentObservation(MODEL), detections, []) == []


def test_a_map_that_tells_the_heading_is_used() -> None:
    about = HeadingMixture.about(MODEL.prior, 0.7, 0.05)
    assert len(about.log_weight) == 1 and about.mean[0, -1] == 0.7
    broad = HeadingMixture.about(MODEL.prior, 0.7, 0.5)
    mean, _, _ = broad.best()
    assert abs(mean[-1] - 0.7) < 0.1
    assert len(HeadingMixture.about(MODEL.prior, 0.0, 4.0).log_weight) == len(
        HeadingMixture.all_around(MODEL.prior).mean
    )


@pytest.mark.slow
def test_the_crop_of_a_mapped_object_finds_it() -> None:
    random = np.random.default_rng(5)
    descriptors = random.normal(size=(10, 3))
    variances = np.full((10, 3), 0.02**2)
    right = 0
    for number in range(10):
        azimuth = float(random.uniform(-np.pi, np.pi))
        seen = view(MODEL, azimuth, descriptors[number], seed=number)
        found = lookalikes(MODEL, seen.feature, descriptors, variances, np.ones(10), elevation_rad=0.0)
        assert found.probabilities.sum() + found.unknown == pytest.approx(1.0)
        if found.ranking()[0] == number:
            right += 1
            assert abs(np.angle(np.exp(1j * (found.azimuth_rad[number] - azimuth)))) < 0.4
    assert right >= 8


def test_what_is_not_on_the_map_is_unknown() -> None:
    belief = DescriptorBelief(np.array([[2.0, 2.0, 2.0]]), np.full((1, 3), 0.02))
    other = view(MODEL, 0.3, np.array([-1.0, -1.0, 0.5]))
    found = lookalikes(MODEL, other.feature, belief.mean, belief.sigma**2, np.ones(1), elevation_rad=0.0)
    assert found.unknown > 0.9
    gone = lookalikes(MODEL, other.feature, belief.mean, belief.sigma**2, np.zeros(1), elevation_rad=0.0)
    assert gone.probabilities[0] == 0.0
