"""Factors are made anew until their views settle, also where the decoder of descriptors bends."""

from dataclasses import dataclass, replace

import gtsam
import numpy as np
import pytest
from worlds.scenes.one_object import (
    CLASSES,
    GEOMETRY,
    LOOK,
    MANIFOLD,
    OBJECT,
    ROBOT,
    SPACES,
    TARGET,
    classed,
    detection,
    extend,
    path,
    root,
    step,
)
from worlds.views.harmonic_model import HarmonicModel

from semantic_slam.inference.models.latent.factor import exact_factor
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.smoothing import batch_update
from semantic_slam.inference.smoothing.batch_update import Extension
from semantic_slam.inference.smoothing.semantic_factors import (
    MOVED_DESCRIPTOR,
    LinearisationPoints,
    SemanticFactor,
    SemanticFactorMaker,
)
from semantic_slam.latent.model import LatentPrediction
from semantic_slam.viewpoint.model import Viewpoints


@dataclass(frozen=True)
class OneDimension:
    """What decoders of one number have in common."""

    num_dimensions: int = 1
    class_names: tuple[str, ...] = ()

    @property
    def prior(self):
        return HarmonicModel(num_dimensions=1).prior


@dataclass(frozen=True)
class Swinging(OneDimension):
    """A decoder that bends as sin 4e in every direction."""

    num_features: int = 4
    noise: float = 0.05

    def predict(self, viewpoints: Viewpoints, descriptors: np.ndarray) -> LatentPrediction:
        azimuth = np.asarray(viewpoints.azimuth_rad)[:, None]
        e = descriptors[:, :1]
        orders = np.arange(1, 1 + self.num_features)
        wave, slope = np.cos(orders * azimuth), -orders * np.sin(orders * azimuth)
        bend, bend_slope = np.sin(4.0 * e), 4.0 * np.cos(4.0 * e)
        by_direction = np.stack([slope * bend, np.zeros_like(slope)], axis=-1)
        return LatentPrediction(
            wave * bend, np.full_like(wave, self.noise), by_direction, (wave * bend_slope)[..., None]
        )


@dataclass(frozen=True)
class Bent(OneDimension):
    """(e, e^2), wherever it is seen from. About e = 0, Gauss-Newton steps from e to -2 r e where r is left of e^2."""

    num_features: int = 2

    def predict(self, viewpoints: Viewpoints, descriptors: np.ndarray) -> LatentPrediction:
        e = descriptors[:, :1]
        mean = np.concatenate([e, e**2], axis=1)
        by_descriptor = np.stack([np.ones_like(e), 2.0 * e], axis=1)
        return LatentPrediction(mean, np.full_like(mean, 0.1), np.zeros((len(e), 2, 2)), by_descriptor)


def looked_at(k: int, seen: PlanarDetection, guess: np.ndarray) -> Extension:
    """A step from which the object is seen, of which the descriptor is to be found."""
    seen_as = SemanticFactor(
        robot_key=ROBOT[k + 1], object_key=TARGET, detection=seen, assigned_class=-1, descriptor_key=LOOK
    )
    return step(k, [seen_as], seen, guess)


def bent(start: float) -> Extension:
    """The first step, with a view that no descriptor explains, which begins at ``start``."""
    extension, begin = looked_at(0, detection(path(1), np.array([0.0, -0.7])), path(1)), np.array([start])
    extension.graph.add(gtsam.PriorFactorVector(LOOK, np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, 1.0)))
    extension.values.insert(LOOK, begin)
    return replace(extension, start={**extension.start, LOOK: begin})


@pytest.mark.parametrize("damped", [True, False])
def test_half_way_ends_a_swing(damped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Undamped, the updates do not end."""
    calls = []
    renewed = batch_update._renewed
    monkeypatch.setattr(batch_update, "_renewed", lambda *parts: calls.append(parts) or renewed(*parts))
    if not damped:
        monkeypatch.setattr(batch_update, "_halfway", lambda now, fork, measurements: now)
    latent = LatentObservation(Bent())
    grown = extend(root(SemanticFactorMaker(SPACES, GEOMETRY, latent)), bent(0.3))
    assert (len(calls) < batch_update.MAX_UPDATES) == damped
    assert (abs(grown.descriptors([LOOK])[0, 0]) < MOVED_DESCRIPTOR) == damped


@pytest.mark.parametrize(
    ("thresholds", "converged", "renewed"),
    [(0.8, True, False), (1.2, True, False), (1.7, True, True), (1.2, False, True)],
)
def test_a_factor_hardly_off_waits_until_its_object_is_seen_again(
    thresholds: float, converged: bool, renewed: bool
) -> None:
    latent = LatentObservation(Bent())
    extension = bent(0.0)
    smoother = extend(root(SemanticFactorMaker(SPACES, GEOMETRY, latent)), extension)
    now = smoother.points([0])
    off = now.descriptors + thresholds * MOVED_DESCRIPTOR * latent.prior.sigma
    moved = replace(
        smoother,
        factor_table=replace(smoother.factor_table, points=LinearisationPoints.stacked(now.robots, now.objects, off)),
    )
    assert batch_update._to_renew(
        {7: batch_update._Fork(extension=extension, smoother=moved, converged=converged)}
    ) == {7: [0] if renewed else []}
    next_keyframe = batch_update._stale([moved], [[TARGET]])[0]
    assert next_keyframe.rows == ([0] if thresholds > 1.0 else [])


def test_a_factor_does_not_fall_behind_a_creeping_view() -> None:
    """An object that turns by less than a relinearisation per keyframe: its factors follow, a keyframe late at most."""
    semantics = SemanticFactorMaker(SPACES, CLASSES)
    smoother = root(semantics)
    for k in range(8):
        extension = classed(k, 0.0)
        turn = MANIFOLD.prior_factors(TARGET, OBJECT + np.array([0.0, 0.0, 0.07 * (k + 1)]), 1e-4 * 0.3**k * np.eye(3))[
            0
        ]
        extension.graph.add(turn)
        smoother = extend(smoother, extension)
    rows = smoother.factor_table.linear_rows()
    now = smoother.points(rows)
    behind = np.abs(now.objects[:, 2] - smoother.factor_table.points.objects[:, 2])
    assert now.objects[0, 2] - OBJECT[2] > 0.4
    assert behind.max() < 0.1 + 0.08


@pytest.mark.parametrize(("jumped", "updates"), [(False, 8), (False, 1), (True, 8)])
@pytest.mark.parametrize("start", [0.05, 0.33, 0.8])
def test_descriptors_settle_at_the_optimum_and_every_view_counts_once(
    start: float, jumped: bool, updates: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By updates alone, where they do not suffice, and where the whole is optimised at once."""
    monkeypatch.setattr(batch_update, "MAX_UPDATES", updates)
    model = Swinging()
    latent = LatentObservation(model)
    smoother = root(SemanticFactorMaker(SPACES, GEOMETRY, latent))
    true = np.array([0.37])
    for k in range(4):
        x = path(k + 1)
        views = SPACES.viewpoints(x[None], OBJECT[None], np.zeros(2))
        seen = detection(x, model.predict(views, true[None]).mean[0] + 0.02)
        extension = looked_at(k, seen, x)
        begin = np.array([start]) if k == 0 else smoother.descriptors([LOOK])[0]
        if k == 0:
            prior = latent.prior_of(0)
            sigma = gtsam.noiseModel.Diagonal.Sigmas(prior.sigma[0])
            extension.graph.add(gtsam.PriorFactorVector(LOOK, prior.mean[0], sigma))
            extension.values.insert(LOOK, begin)
        began = {**extension.start, LOOK: begin}
        smoother = extend(smoother, replace(extension, start=began, jumped=jumped))
    factors = gtsam.NonlinearFactorGraph(smoother.isam.getFactorsUnsafe())
    assert sum(factors.exists(i) for i in range(factors.size())) == 2 + 1 + 4 * 3
    graph = smoother.kept()
    assert graph.size() == 2 + 1 + 4 * 2
    for measurements in smoother.factor_table.measurements:
        graph.add(exact_factor(latent, measurements.detection, measurements.keys))
    found = smoother.isam.calculateEstimate()
    best = gtsam.LevenbergMarquardtOptimizer(graph, found).optimize()
    np.testing.assert_allclose(found.atVector(LOOK), best.atVector(LOOK), atol=0.05)
    np.testing.assert_allclose(MANIFOLD.states(found), MANIFOLD.states(best), atol=0.01)
    assert abs(found.atVector(LOOK)[0] - true[0]) < 0.1
