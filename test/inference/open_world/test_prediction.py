"""Where objects are too many for a joint covariance: those that fit stay, and what is cut is counted."""

from collections.abc import Collection
from typing import Any

import numpy as np
import pytest
from worlds.drives.open_room import make_room

from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.association.gating import best_assignments, pair_densities
from semantic_slam.inference.building import problem_of
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.open_world.prediction import nearby
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.open_world.prediction.predictor import FrameInput, Predictor
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.inference.world.roots import tracking_root

AROUND = 24
MOTION = Motion(np.zeros(3), 1e-4 * np.eye(3))


def prediction(
    detection: PlanarDetection, limit: int, sigma_m: float = 0.3, wanted: Collection[int] = (), **world: Any
) -> Prediction:
    """Objects on a circle of 3 m about the robot, at every 15 degrees, the first straight behind it."""
    angles = np.pi + 2.0 * np.pi * np.arange(AROUND) / AROUND
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.01, 1.0, 1.0, 1.0])
    objects = tuple(
        ObjectPrior(
            object_id=i,
            name=str(i),
            pose=pose_vector_from_planar(np.array([3.0 * np.cos(a), 3.0 * np.sin(a), 0.0])),
            covariance=covariance,
            class_probabilities={},
        )
        for i, a in enumerate(angles)
    )
    room = make_room(1, map_prior=MapPrior(objects), open_world={"max_joint_objects": limit, **world})
    problem = problem_of(room.run)
    component = tracking_root(problem, 0)
    return Predictor(problem.model, problem.open_world, problem.detection_errors).predict(
        component, FrameInput(motion=MOTION, detections=[detection]), wanted=wanted
    )


def detection(range_m: float) -> PlanarDetection:
    """Straight ahead, where number 12 is."""
    return PlanarDetection(
        range_m=range_m,
        bearing_rad=0.0,
        covariance=np.diag([0.01, 0.001]),
        sensor=np.zeros(2),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )


@pytest.mark.parametrize("range_m", [3.0, np.nan], ids=["range", "bearing alone"])
def test_those_that_fit_best_stay(range_m: float) -> None:
    assert prediction(detection(range_m), 3).near_ids.tolist() == [11, 12, 13]


def test_those_that_a_history_names_stay_however_ill_they_fit() -> None:
    """Else a history that is replayed would begin a known object anew, where better ones are too many."""
    assert prediction(detection(3.0), 3, wanted=[0]).near_ids.tolist() == [0, 12, 13]
    assert prediction(detection(3.0), 3, wanted=[0, 4, 8, 16]).near_ids.tolist() == [0, 4, 8, 16]


@pytest.mark.parametrize("range_m", [3.0, np.nan], ids=["range", "bearing alone"])
def test_what_is_cut_weighs_no_more_than_is_counted(range_m: float) -> None:
    item = detection(range_m)
    cut, full = prediction(item, 3), prediction(item, AROUND)
    assert (full.log_beyond == -np.inf).all()
    problem = problem_of(make_room(1).run)
    pairs = pair_densities(problem.spaces, problem.model, [item], full.predicted)
    others = ~np.isin(full.near_ids, cut.near_ids)
    weight = 0.9 / (1.0 - 0.9)  # of a detection against a miss of an object that certainly exists
    assert np.isfinite(cut.log_beyond).all()
    assert cut.log_beyond[0] >= np.log(weight) + np.logaddexp.reduce(pairs.log_density[0, others])


def test_an_object_on_the_other_side_of_the_robot_is_not_brought_in_front_of_it_by_a_step_that_goes_too_far() -> None:
    """The neighbours 30 degrees aside are weighed at their modes (integrated: -10.2); those behind have none nearby."""
    item = detection(np.nan)
    full, problem = prediction(item, AROUND), problem_of(make_room(1).run)
    pairs = pair_densities(problem.spaces, problem.model, [item], full.predicted)
    np.testing.assert_allclose(pairs.log_density[0, [11, 12, 13]], [-1.72, 1.33, -1.72], atol=0.03)
    np.testing.assert_allclose(pairs.log_density[0, [10, 14]], -10.3, atol=0.3)
    assert (pairs.log_density[0, :9] < -35.0).all() and (pairs.log_density[0, 16:] < -35.0).all()


def test_the_cut_counts_as_left_out() -> None:
    known, new = np.array([[0.0]]), np.array([-2.0])
    alone = best_assignments(known, np.ones((1, 1), dtype=bool), new, 10, np.inf)
    beyond = best_assignments(known, np.ones((1, 1), dtype=bool), new, 10, np.inf, np.array([-3.0]))
    assert alone.log_left_out == -np.inf
    assert beyond.log_left_out == pytest.approx(-3.0)


def test_an_uncertain_object_may_be_within_reach() -> None:
    """At twice the sensor's range by its mean, and as uncertain as that is far."""
    near = prediction(detection(3.0), AROUND, sigma_m=3.0)
    assert len(near.in_reach) == AROUND
    far = make_room(
        1,
        map_prior=MapPrior(
            (
                ObjectPrior(
                    object_id=0,
                    name="0",
                    pose=pose_vector_from_planar(np.array([10.0, 0.0, 0.0])),
                    covariance=4.0 * np.eye(6),
                    class_probabilities={},
                ),
            )
        ),
    )
    problem = problem_of(far.run)
    component = tracking_root(problem, 0)
    found = Predictor(problem.model, problem.open_world, problem.detection_errors).predict(
        component, FrameInput(motion=MOTION, detections=[detection(3.0)])
    )
    assert found.in_reach.tolist() == [0]


def test_a_local_map_holds_what_the_sensor_may_see_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within 45 degrees of straight ahead, and what a small turn brings there: three at 15 degrees on either side."""
    monkeypatch.setattr(nearby, "LOCAL_OBJECTS", 0)
    world = {"iterate_updates": False, "field_of_view_rad": 0.5 * np.pi}
    found = prediction(detection(3.0), 1, **world)
    assert found.near_ids.tolist() == [12]
    assert found.local.ids.tolist() == [9, 10, 11, 12, 13, 14, 15]
