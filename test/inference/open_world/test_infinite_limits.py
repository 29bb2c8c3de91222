"""Parameters that may be infinite: a run is that of the limit which they stand for, without a warning of numpy."""

from typing import Any

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe

pytestmark = pytest.mark.filterwarnings("error")
INF = float("inf")
REPEATED = {"correlated_share": 0.5}


def belief(**values: Any) -> HybridBelief:
    """After three keyframes with two objects, which may move."""
    world = {"iterate_updates": False, **values.pop("open_world", {})}
    engine = Engine(
        Configuration.of(
            association="open", semantic_model={"kind": "none"}, moving={"share": 0.1}, open_world=world, **values
        )
    )
    for k in range(3):
        seen = [Detection(range_m=2.0 - 0.1 * k, bearing_rad=0.1), Detection(range_m=3.0, bearing_rad=-0.3 - 0.01 * k)]
        told = engine.process(Keyframe.planar(k, motion=(0.1, 0.0, 0.0), detections=seen))
    return told


@pytest.mark.parametrize(
    ("infinite", "limit"),
    [
        (
            {"detection_errors": {**REPEATED, "neighbour_m": INF}},
            {"detection_errors": {**REPEATED, "common_range_share": 1.0, "common_bearing_share": 1.0}},
        ),
        ({"detection_errors": {**REPEATED, "motion_m": INF}}, {"detection_errors": {**REPEATED, "motion_m": 1e15}}),
        ({"detection_errors": {**REPEATED, "motion_rad": INF}}, {"detection_errors": {**REPEATED, "motion_rad": 1e15}}),
        ({"open_world": {"detection_half_ranges_m": [INF]}}, {}),
        (
            {"open_world": {"rates_ratio": INF, "clutters_per_frame": [0.1, 0.3]}},
            {"open_world": {"rates_ratio": 1e15, "clutters_per_frame": [0.1, 0.3]}},
        ),
        ({"weights": {"gate": INF, "importance_gate": INF}}, {"weights": {"gate": 1e15, "importance_gate": 1e15}}),
        (
            {"open_world": {"merge_position_m": INF, "merge_heading_rad": INF, "merge_object_m": INF}},
            {"open_world": {"merge_position_m": 1e15, "merge_heading_rad": 1e15, "merge_object_m": 1e15}},
        ),
    ],
)
def test_an_infinite_parameter_is_the_limit_that_it_stands_for(infinite: dict, limit: dict) -> None:
    found, expected = belief(**infinite), belief(**limit)
    np.testing.assert_allclose(found.log_weights, expected.log_weights, atol=1e-9)
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-9)
    np.testing.assert_allclose(found.pose_covariances, expected.pose_covariances, atol=1e-12)
    np.testing.assert_allclose(found.existence, expected.existence, atol=1e-9)
    np.testing.assert_allclose(found.moving, expected.moving, atol=1e-9)


def test_a_half_range_that_may_be_infinite_has_an_infinite_mean_and_no_standard_deviation() -> None:
    told = belief(open_world={"detection_half_ranges_m": [INF, 3.0]})
    assert told.noise_names == ("open_world.detection_half_range_m",)
    assert told.noise_values[0] == INF and np.isnan(told.noise_sigmas[0])
