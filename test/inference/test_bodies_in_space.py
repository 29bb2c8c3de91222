"""Objects in space that look different from every side: in the plane they are those of the planar engine."""

import numpy as np
import pytest
from worlds.bodies import IN_PLANE, drive, level_run, planar_run
from worlds.spatial_fixtures import NOTHING_LEFT_OUT

from semantic_slam import Engine

LAPLACE = {**NOTHING_LEFT_OUT["weights"], "method": "laplace"}
PARAMETRIC = {"kind": "parametric", "alpha": 0.6, "concentration": 6.0, "outlier_share": 0.0}


def weights_of(engine: Engine) -> dict[tuple, float]:
    """Of every association and class assignment."""
    found: dict[tuple, float] = {}
    for live in engine.live.values():
        key = tuple((step.association, step.class_assignment) for step in live.lineage)
        found[key] = found.get(key, 0.0) + float(np.exp(live.log_weight))
    return found


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
