"""What a history weighs whose path a return has moved: as if all had been linearised there before."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.geometry import se2
from semantic_slam.inference.smoothing import growth, smoother

SIGMAS = np.array([0.05, 0.02])
POSTS = np.array([[2.0, 1.5], [3.0, -1.0], [0.5, 3.0]])
TURN = np.array([3.0, 0.0, 2.0])
BEND = np.array([0.6, -0.9, 0.75])
"""By which the blind turn is not what odometry tells."""


def log_evidence() -> float:
    """Of a blind turn, a return to three posts and a few steps past them, all numbers being those of the posts."""
    engine = Engine(
        Configuration.of(
            association="open",
            semantic_model={"kind": "none"},
            open_world={"max_range_m": 8.0, "field_of_view_rad": 6.2, "iterate_updates": False},
            detection_errors={"correlated_share": 0.9},
            pruning={"max_hypotheses": 1},
        ),
        initial_covariance=np.diag([1e-6] * 3),
    )
    robot = np.zeros(3)
    for k in range(12):
        motion, sigmas = np.array([0.2, 0.0, 0.1]), (0.02, 0.02, 0.02)
        if k == 3:
            motion, sigmas = TURN, (0.3, 0.3, 0.4)
        robot = se2.compose(robot, motion if k != 3 else se2.compose(motion, BEND))
        shown = POSTS if k < 3 else POSTS[: k - 4] if k > 4 else []
        points = [se2.between(robot, np.array([*post, 0.0]))[:2] for post in shown]
        polar = [(float(np.hypot(*p)), float(np.arctan2(p[1], p[0]))) for p in points]
        detections = [Detection(range_m=r, bearing_rad=b, covariance=np.diag(SIGMAS**2)) for r, b in polar]
        engine.process(Keyframe.planar(k, motion=motion, motion_sigmas=sigmas, detections=detections))
    assert {number for live in engine.live.values() for step in live.lineage for number in step.association} == {
        0,
        1,
        2,
    }
    return engine.log_evidence


def test_keyframes_after_a_return_are_weighed_where_it_has_moved_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = log_evidence()
    monkeypatch.setattr(growth, "AT_ONCE", np.inf)
    late = log_evidence()
    monkeypatch.setattr(growth, "AT_ONCE", 0.0)
    monkeypatch.setattr(smoother, "STEPPED_SKIP", 1)
    always = log_evidence()
    assert abs(shipped - always) < 0.1
    assert abs(late - always) > 0.25
