"""Objects in space that look different from every side: in the plane they are those of the planar engine."""

import numpy as np
import pytest
from worlds.exact.spatial_fixtures import NOTHING_LEFT_OUT
from worlds.scenes.bodies import IN_PLANE, MODEL, NAMES, drive, level_run, planar_run

from semantic_slam import Engine
from semantic_slam.training.viewpoint.regression import fit_class
from semantic_slam.training.viewpoint.samples import ClassSamples
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.store import save_model

LAPLACE = {**NOTHING_LEFT_OUT["weights"], "method": "laplace"}
PARAMETRIC = {"kind": "parametric", "alpha": 0.6, "concentration": 6.0, "outlier_share": 0.0}


def weights_of(engine: Engine) -> dict[tuple, float]:
    """Of every association and class assignment."""
    found: dict[tuple, float] = {}
    for live in engine.live.values():
        key = tuple((step.association, step.class_assignment) for step in live.lineage)
        found[key] = found.get(key, 0.0) + float(np.exp(live.log_weight))
    return found


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """Class models of both classes, fitted on views of one height."""
    path = tmp_path_factory.mktemp("models") / "models.safetensors"
    azimuth = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    views = Viewpoints(azimuth, np.zeros(24), np.ones(24))
    noise = 0.1 * np.random.default_rng(0).normal(size=(2, 24, 4, 2))
    means = [MODEL.predict(np.full(24, number), views).mean[:, None] for number in range(2)]
    fits = [
        fit_class(ClassSamples(azimuth, own + off, np.zeros((24, 4, 2, 2))))
        for own, off in zip(means, noise, strict=True)
    ]
    save_model(GaussianProcessModel(NAMES, NAMES, fits), path, {})
    return {"kind": "gp_independent", "path": str(path), "outlier_share": 0.0}


@pytest.mark.long
def test_fitted_class_models_too(fitted: dict) -> None:
    """As near as modes are searched; those whose errors repeat, which are sampled, as near as samples are."""
    frames = drive(np.random.default_rng(6), named=False)
    values = {"association": "enumerated", "weights": LAPLACE}
    for kind, tolerance in ((fitted, 1e-4), ({**fitted, "kind": "gp_correlated"}, 0.1)):
        (_, flat), (_, level) = (run(frames, kind, **values) for run in (planar_run, level_run))
        np.testing.assert_allclose(level.class_probabilities, flat.class_probabilities, atol=tolerance)
        np.testing.assert_allclose(level.poses[0], flat.poses[0], atol=tolerance)


@pytest.mark.long
@pytest.mark.parametrize("kind", [PARAMETRIC, {"kind": "none"}])
@pytest.mark.parametrize("association", ["enumerated", "given"])
def test_bodies_in_the_plane_are_the_planar_engine_s(kind: dict, association: str) -> None:
    """Weights, poses, covariances, classes to 1e-6: height, roll and pitch are known, and all is symmetric in them."""
    frames = drive(np.random.default_rng(4), named=association == "given")
    values = {"association": association, "weights": LAPLACE}
    (plane, flat), (space, level) = (run(frames, kind, **values) for run in (planar_run, level_run))
    expected, found = weights_of(plane), weights_of(space)
    assert sorted(expected) == sorted(found)
    assert max(abs(found[key] - weight) for key, weight in expected.items()) < 1e-6
    heavy = np.flatnonzero(flat.log_weights > np.log(1e-3))
    order = [list(space.live).index(list(plane.live)[row]) for row in heavy]
    np.testing.assert_allclose(level.poses[order], flat.poses[heavy], atol=1e-6)
    spreads = level.pose_covariances[order], flat.pose_covariances[heavy]
    np.testing.assert_allclose(*(own[:, IN_PLANE][:, :, IN_PLANE] for own in spreads), atol=1e-6)
    np.testing.assert_allclose(level.object_poses, flat.object_poses, atol=1e-6)
    rows = np.ix_(range(3), IN_PLANE, IN_PLANE)
    np.testing.assert_allclose(level.object_covariances[rows], flat.object_covariances[rows], atol=1e-6)
    np.testing.assert_allclose(level.class_probabilities, flat.class_probabilities, atol=1e-6)
