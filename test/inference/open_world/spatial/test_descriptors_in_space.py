"""Learned descriptors of upright bodies in an open world in space: what views tell of descriptor, class and yaw."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2
from worlds.scenes.open_flights import FINE, OpenFlight, from_around
from worlds.views.harmonic_model import HarmonicModel
from worlds.views.latent_toy import toy_model

from semantic_slam import Detection, Engine, InputError, Keyframe
from semantic_slam.geometry import so3
from semantic_slam.geometry.log_space import LOG_2PI
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.inputs.score_features import FeatureReader
from semantic_slam.inference.inputs.spatial_reader import SpatialReader
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.semantics.descriptors.descriptor_tables import DescriptorTables
from semantic_slam.latent.model import DescriptorModel
from semantic_slam.latent.store import save_latent_model

MODEL = HarmonicModel(noise=0.3)
FROM_ABOVE = np.append([0.0, 0.0, 1.8], so3.exp(np.array([0.0, 0.6, 0.0])))
YAWS = np.linspace(-np.pi, np.pi, 720, endpoint=False)


class DescribedFlight(OpenFlight):
    """A flight among bodies with descriptors; a detection carries the feature that its body shows from there."""

    def __init__(self, seed: int, model: DescriptorModel, **values: Any) -> None:
        self.model, self.looks = model, np.random.default_rng([seed, 2])
        self.yaws = self.looks.uniform(-np.pi, np.pi, 12)
        self.descriptors = self.looks.normal(size=(12, model.num_dimensions))
        self.views: list[tuple[int, np.ndarray, np.ndarray]] = []  # of which body, the camera from it, and the feature
        super().__init__(seed, **{"observation": "range_bearing", **values})

    def of_model(self) -> "DescribedFlight":
        """The flight with a model that no file holds."""
        observation = LatentObservation(self.model)
        problem = replace(
            self.engine.problem,
            reader=SpatialReader(ConfiguredNoise(), features=FeatureReader(self.model.num_features)),
            semantics=DescriptorTables(observation),
            latent=observation,
        )
        run = replace(self.engine.run, class_names=self.model.class_names)
        self.engine = Engine.of_run(run, InProcessPool(1, problem), problem)
        return self

    def _detection(self, away: np.ndarray, n: int) -> Detection:
        camera = self.x[:3] - self.points[n]
        told = self.model.predict(from_around(camera, self.yaws[n : n + 1]), self.descriptors[n : n + 1])
        feature = told.mean[0] + told.sigma[0] * self.looks.normal(size=self.model.num_features)
        self.views.append((n, camera, feature))
        return replace(super()._detection(away, n), embedding=feature)


def by_yaw(views: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log evidence (720,) of views of one body for each yaw, and the descriptor's mean (720, 3) and covariance there.

    Features are linear in the descriptor, so that all three are in closed form.
    """
    size, precision, shift = MODEL.num_dimensions, np.tile(np.eye(3), (720, 1, 1)), np.zeros((720, 3))
    energy, nothing = np.zeros(720), np.zeros((720, size))
    for camera, feature in views:
        told = MODEL.predict(from_around(camera, YAWS), nothing)
        slope, off = told.by_descriptor / MODEL.noise, (feature - told.mean) / MODEL.noise
        precision += np.swapaxes(slope, 1, 2) @ slope
        shift += np.einsum("bfl,bf->bl", slope, off)
        energy += 0.5 * (off**2).sum(axis=1) + MODEL.num_features * (np.log(MODEL.noise) + 0.5 * LOG_2PI)
    mean = np.linalg.solve(precision, shift[..., None])[..., 0]
    log_evidence = -energy + 0.5 * (shift * mean).sum(axis=1) - 0.5 * np.linalg.slogdet(precision)[1]
    return log_evidence, mean, np.linalg.inv(precision)


def test_descriptors_and_yaws_are_those_of_all_views_together() -> None:
    """In closed form for each yaw, from the place and height of every view, as near as cells of 2.5 degrees are."""
    given = {"errors": FINE, "start": FROM_ABOVE, "semantic_model": {"kind": "none"}}
    described, plain = DescribedFlight(4, MODEL, **given).of_model(), DescribedFlight(4, MODEL, **given)
    for own, without in zip(described.beliefs(12), plain.beliefs(12), strict=True):
        np.testing.assert_allclose(own.object_poses[:, :3], without.object_poses[:, :3], atol=1e-9)
    total, compared = 0.0, 0
    for row, item in enumerate(own.objects):
        n = int(np.linalg.norm(described.points - item.position, axis=1).argmin())
        log_evidence, mean, covariance = by_yaw([view[1:] for view in described.views if view[0] == n])
        whole = np.logaddexp.reduce(log_evidence)
        share = np.exp(log_evidence - whole)
        total += whole - np.log(len(YAWS))
        expected = share @ mean
        spread = share @ (np.einsum("bii->bi", covariance) + (mean - expected) ** 2)
        np.testing.assert_allclose(own.descriptors[row], expected, atol=0.5 * np.sqrt(spread).max() + 0.01)
        np.testing.assert_allclose(np.sqrt(own.descriptor_covariances[row]), np.sqrt(spread), rtol=0.3)
        moment = share @ np.exp(1j * YAWS)
        if abs(moment) > 0.9:
            compared += 1
            sigma = np.sqrt(-2.0 * np.log(abs(moment)))
            assert abs(wrap_angle(planar_from_pose_vector(item.pose)[2] - np.angle(moment))) < 0.5 * sigma + 0.02
            assert np.sqrt(item.covariance[5, 5]) == pytest.approx(sigma, rel=0.4, abs=0.01)
    assert compared >= 3
    told = described.engine.log_evidence - plain.engine.log_evidence
    assert told == pytest.approx(total, abs=0.07 * len(described.views))


def test_a_flight_tells_descriptors_and_how_things_are_turned() -> None:
    """Each thing once, with its own descriptor and yaw, as far off as is stated."""
    flight = DescribedFlight(0, MODEL, semantic_model={"kind": "none"}).of_model()
    *_, belief = flight.beliefs(20, clutter=0.2)
    rows = np.flatnonzero(belief.existence > 0.5)
    nearest = [int(np.linalg.norm(flight.points - belief.object_poses[row, :3], axis=1).argmin()) for row in rows]
    assert sorted(nearest) == sorted(flight.seen)
    off, turned = [], []
    for row, n in zip(rows, nearest, strict=True):
        variance = belief.object_covariances[row, 5, 5]
        if variance > 0.1:  # seen from few sides
            continue
        sigmas = np.sqrt(belief.descriptor_covariances[row])
        off += ((belief.descriptors[row] - flight.descriptors[n]) / sigmas).tolist()
        yaw = planar_from_pose_vector(belief.object_poses[row])[2]
        turned.append(wrap_angle(yaw - flight.yaws[n]) / np.sqrt(variance))
    assert len(turned) >= 4
    for errors in (off, turned):
        low, high = chi2.interval(0.999, len(errors))
        assert low < np.square(errors).sum() < high


def test_a_file_of_a_latent_space_is_all_that_is_set(tmp_path: Path) -> None:
    """Features come as embeddings; features of another length are refused."""
    model, path = toy_model(), tmp_path / "latent.safetensors"
    save_latent_model(model, {}, path)
    flight = DescribedFlight(1, model, semantic_model={"kind": "latent", "path": str(path)})
    *_, belief = flight.beliefs(6)
    assert belief.descriptors.shape == (len(belief.object_ids), model.num_dimensions)
    assert np.isfinite(belief.descriptors[belief.existence > 0.5]).all()
    assert (belief.descriptor_covariances.min(axis=1) < 0.5 * model.prior.sigma.max() ** 2).any()
    strange = Detection.along([1.0, 0.0, 0.0], 1.0, embedding=np.ones(3))
    with pytest.raises(InputError, match="features"):
        flight.engine.process(Keyframe.spatial(6, detections=[strange]))
