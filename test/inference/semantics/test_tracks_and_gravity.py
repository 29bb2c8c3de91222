"""Samples of a track in space, given a measurement of gravity."""

import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.inference.association.closed_prediction import predict
from semantic_slam.inference.models.spatial.gravity import Gravity
from semantic_slam.inference.models.spatial.observation import SpatialObservation
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.semantics.track_samples import PredictedSamples
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.growth import certain, grow
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import robot_key
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate

MODEL = SpatialObservation()
SPACE = MODEL.spaces.robot


def test_samples_of_a_track_follow_gravity_as_the_factor_has_them() -> None:
    """Those before the measurement too; deviations are those from the means that prediction shifts."""
    start = se3.exp(np.array([0.1, -0.2, 0.4, 1.0, 0.0, 0.5]))
    root = np.random.default_rng(0).normal(size=(6, 6)) * 0.02
    control = se3.exp(np.array([0.1, 0.2, 0.0, 0.3, 0.0, 0.1]))
    true = se3.retract(se3.compose(start, control), np.array([0.02, -0.02, 0.0, 0.0, 0.0, 0.0]))
    motion = Motion(control, 0.01**2 * np.eye(6), gravity=Gravity(so3.matrix(true[3:])[2], 0.02**2))
    target = GaussianPrior(np.array([2.0, 0.0, 1.0]), 0.1**2 * np.eye(3))
    component = Component.root(MODEL.spaces, MODEL, GaussianPrior(start, root @ root.T + 1e-4 * np.eye(6)), {0: target})
    samples = PredictedSamples.of(component, motion, [0], {}, 200_000, seed=1)
    np.testing.assert_allclose(
        np.cov(samples.ahead.T), predict([component], motion, [0], [{}]).covariance[0], atol=4e-4, rtol=0.02
    )
    update = ComponentUpdate(
        observed=[],
        objects=[],
        robot=SPACE.compose(start, control),
        predicted=SPACE.compose(start, control),
        new_objects={},
        existence=ExistenceUpdate.starting(component.objects, []),
    )
    grown = certain(grow([component], motion, [update])[0])
    before, past = [robot_key(-1)], samples.past.deviations[:, samples.past.rows[robot_key(-1)]]
    np.testing.assert_allclose(np.cov(past.T), grown.joint_covariance(before), atol=4e-4, rtol=0.02)
    np.testing.assert_allclose(past.mean(axis=0), SPACE.local(start, grown.states(before)[0, :7]), atol=2e-3)
