"""A motion that is known thousands of times as well as its start: Cholesky takes the system for indeterminate."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe

STEP_M, NOISE = 0.2, 1e-3


def driven(start_sigmas: tuple[float, float, float], motion_sigma: float, **settings: object) -> HybridBelief:
    """Six keyframes along a wall of two things."""
    configuration = Configuration.of(semantic_model={"kind": "none"}, association="open", **settings)
    around = np.diag(start_sigmas) ** 2
    engine = Engine(configuration, initial_pose=(0, 0, 0), initial_covariance=around)
    for k in range(6):
        places = ((3.0 - STEP_M * k, 0.1), (3.0 - STEP_M * k, 1.0))
        belief = engine.process(
            Keyframe.planar(
                k,
                motion=(STEP_M if k else 0.0, 0.0, 0.0),
                motion_sigmas=(motion_sigma,) * 3,
                detections=[Detection.at(*place, covariance=NOISE * np.eye(2)) for place in places],
            )
        )
    return belief


@pytest.mark.parametrize("errors", [{}, {"detection_errors": {"correlated_share": 0.9}}], ids=["independent", "repeat"])
@pytest.mark.parametrize("start_sigmas", [(1.0, 1.0, 0.3), (0.05, 0.9, 0.001)])
def test_single_steps_lose_no_hypothesis_by_it(start_sigmas: tuple[float, float, float], errors: dict) -> None:
    belief = driven(start_sigmas, 1e-5, open_world={"iterate_updates": False}, **errors)
    assert len(belief.objects) == 2
    np.testing.assert_allclose(belief.poses[0, :2], [5 * STEP_M, 0.0], atol=1e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(belief.pose_covariances[0])[0]), start_sigmas[0], rtol=0.1)


def test_they_then_say_what_iterated_updates_do() -> None:
    single, iterated = (driven((0.05, 0.9, 0.001), 1e-4, open_world={"iterate_updates": own}) for own in (False, True))
    np.testing.assert_allclose(single.poses[0], iterated.poses[0], atol=1e-4)
    np.testing.assert_allclose(single.pose_covariances[0], iterated.pose_covariances[0], rtol=0.02, atol=1e-6)
    for one, other in zip(single.objects, iterated.objects, strict=True):
        np.testing.assert_allclose(one.position, other.position, atol=1e-3)
        np.testing.assert_allclose(one.covariance[:2, :2], other.covariance[:2, :2], rtol=0.05, atol=1e-6)
