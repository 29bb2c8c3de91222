"""Limits of visibility cut off a part of the Gaussian, also of a hypothesis without a rival: moments by quadrature."""

import numpy as np
import pytest

from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import Configuration, SemanticModelConfiguration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

REACH, SIGMA = 5.0, 1.0
SEEN = (Detection(range_m=None, bearing_rad=0.0, track_id="post"),)


def _moments(
    *frames: tuple[Detection, ...], reach: float = REACH, motion: float = 0.0, num_objects: int = 1, **sections: object
) -> list[tuple[float, float]]:
    """Mean and standard deviation of x at each keyframe; the heading is known and a bearing says nothing of x."""
    places = [(REACH, 0.0), (-60.0, 0.0)][:num_objects]
    names = ["post", "far"]
    known = MapPrior(
        tuple(
            ObjectPrior.planar(n, *place, sigma_m=1e-3, sigma_rad=0.1, name=names[n]) for n, place in enumerate(places)
        )
    )
    settings = {
        "association": "enumerated",
        "semantic_model": {"kind": "none"},
        "closed_world": {"clutter_per_frame": 0.0},
        **sections,
    }
    configuration = Configuration.of(
        visibility={"max_range_m": reach},
        open_world={"iterate_updates": True},
        **settings,
    )
    spread = np.diag([SIGMA, 1e-3, 1e-3]) ** 2
    engine = Engine(configuration, known, initial_pose=np.zeros(3), initial_covariance=spread)
    found = []
    for k, seen in enumerate(frames):
        moved = (motion if k else 0.0, 0.0, 0.0)
        belief = engine.process(Keyframe.planar(k, motion=moved, detections=seen, motion_sigmas=(1e-3,) * 3))
        weights, x = np.exp(belief.log_weights), belief.poses[:, 0]
        mean = float(weights @ x)
        variance = float(weights @ (belief.pose_covariances[:, 0, 0] + (x - mean) ** 2))
        found.append((mean, np.sqrt(variance)))
    return found


def _exact(*limits: float) -> tuple[float, float]:
    """Moments of x at the first keyframe, by quadrature, if it lies above all ``limits``."""
    x = np.linspace(-8.0, 8.0, 160_001)
    density = np.exp(-0.5 * (x / SIGMA) ** 2) * (x >= max(limits))
    density /= density.sum()
    mean = float(density @ x)
    return mean, float(np.sqrt(density @ (x - mean) ** 2))


@pytest.mark.parametrize(
    "sections",
    [
        {},
        {"association": "given", "closed_world": {}},
        {"association": "given", "closed_world": {"wrong_identity_share": 0.0}},
    ],
    ids=["enumerated", "given", "given for sure"],
)
def test_one_hypothesis_by_itself_knows_that_its_robot_sees_the_object(sections: dict[str, object]) -> None:
    (moments,) = _moments(SEEN, **sections)
    assert moments == pytest.approx(_exact(0.0), abs=0.04)


def test_correlated_views_which_know_no_clutter_leave_the_limit_as_it_is() -> None:
    """Even scores of an object of unknown heading say next to nothing; tracks are few samples of the pose."""
    model = load_model(SemanticModelConfiguration())
    assert model is not None
    seen = Detection(range_m=None, bearing_rad=0.0, class_scores=dict.fromkeys(model.class_names, 0.2))
    (moments,) = _moments((seen,), semantic_model={"kind": "gp_correlated"})
    assert moments == pytest.approx(_exact(0.0), abs=0.15)


def test_what_was_seen_still_holds_where_nothing_is_seen() -> None:
    for moments in _moments(SEEN, (), ()):
        assert moments == pytest.approx(_exact(0.0), abs=0.06)


def test_a_robot_that_backs_away_and_still_sees_the_object_is_nearer_than_was_thought() -> None:
    first, second = _moments(SEEN, SEEN, motion=-0.5)
    mean, sigma = _exact(0.0, 0.5)
    assert first == pytest.approx(_exact(0.0), abs=0.06)
    assert second == pytest.approx((mean - 0.5, sigma), abs=0.06)


def test_an_object_that_no_detection_can_be_of_changes_nothing() -> None:
    np.testing.assert_array_equal(_moments(SEEN, SEEN), _moments(SEEN, SEEN, num_objects=2))


def test_without_a_limit_the_hypothesis_is_the_gaussian() -> None:
    (moments,) = _moments(SEEN, reach=0.0)
    assert moments == pytest.approx((0.0, SIGMA), abs=1e-6)
    (moments,) = _moments(SEEN, reach=50.0)
    assert moments == pytest.approx((0.0, SIGMA), abs=0.02)
