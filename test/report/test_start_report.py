"""What a report says of the start that was used, which need not be the configured one."""

import dataclasses
import html
import json
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, run_configuration, small_belief

from semantic_slam.configuration import Configuration, InitialPoseConfiguration, to_dict
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.building import initial_pose_of
from semantic_slam.pipeline.start import without_tilt
from semantic_slam.report.comparison import Run
from semantic_slam.report.document import Analysis, analyse, report_document
from semantic_slam.report.page import render_page
from semantic_slam.report.verdict import warnings

PLANAR = Configuration(initial_pose=InitialPoseConfiguration(mean=(1.0, -2.0, 0.5), sigma=(0.1, 0.2, 0.05)))
SPATIAL = Configuration(
    state_space="spatial",
    initial_pose=InitialPoseConfiguration(mean=(1.0, 2.0, 3.0, 0.0, 0.0, 0.3), sigma=(0.1,) * 6),
)


def started(pose: Array, covariance: Array, settings: str) -> Analysis:
    """A run of one keyframe with this start and configuration."""
    belief = dataclasses.replace(small_belief(0, [1], [0], [1.0], [1], [[0]]), planar="spatial" not in settings)
    run = dataclasses.replace(
        run_configuration(Path("drive"), CLASSES, tuple("1234567")),
        initial_pose=pose,
        initial_covariance=covariance,
        configuration=settings,
    )
    nowhere = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))
    return analyse(Record(run, (belief,), nowhere, {}, None), Path("belief"), "")


def written(configuration: Configuration) -> str:
    return json.dumps(to_dict(configuration))


def said(analysis: Analysis) -> str:
    page = html.unescape(render_page([Run("drive", analysis)], None))
    return page.split("<dt>Start ± σ</dt><dd>")[1].split("</dd>")[0]


@pytest.mark.parametrize("configuration", [PLANAR, SPATIAL])
def test_a_configured_start_is_said_to_be_one(configuration: Configuration) -> None:
    analysis = started(*initial_pose_of(configuration), written(configuration))
    assert report_document(analysis)["start"]["source"] == "configuration"
    assert said(analysis).endswith("; from the configuration")


def test_a_start_that_was_told_is_stated_in_place_of_the_configured_one() -> None:
    """As when a lost robot is given a wide guess on topic initialpose."""
    pose, covariance = pose_vector_from_planar([-5.07, -1.33, 0.0]), covariance_from_planar(np.diag([100, 9e-6, 0.04]))
    analysis = started(pose, covariance, written(PLANAR))
    start = report_document(analysis)["start"]
    assert start["source"] == "told"
    assert start["pose"] == pytest.approx(pose) and np.diag(start["covariance"])[[0, 1, 5]] == pytest.approx(
        [100, 9e-6, 0.04]
    )
    assert said(analysis).startswith("x −5.07 ± 10 m, y −1.33 ± 0.003 m, yaw 0.00 ± 0.2 rad; told on topic initialpose")


def test_gravity_is_named_where_it_gave_roll_and_pitch() -> None:
    pose, covariance = initial_pose_of(SPATIAL)
    yaw, roll = so3.exp(np.array([0.0, 0.0, 0.3])), so3.exp(np.array([0.2, 0.0, 0.0]))
    analysis = started(np.append(pose[:3], so3.product(yaw, roll)), without_tilt(covariance), written(SPATIAL))
    assert report_document(analysis)["start"]["source"] == "configuration and gravity"
    assert "z 3.00 ± 0.1 m, roll 0.20 ± 0.5 rad, pitch 0.00 ± 0.5 rad, yaw 0.30 ± 0.1 rad" in said(analysis)


def test_gravity_is_not_named_where_it_left_the_configured_roll_and_pitch() -> None:
    pose, covariance = initial_pose_of(SPATIAL)
    analysis = started(pose, without_tilt(covariance), written(SPATIAL))
    assert report_document(analysis)["start"]["source"] == "configuration, roll and pitch open"
    assert said(analysis).endswith(
        "; from the configuration, roll and pitch left open, as imu told too little at the first keyframe"
    )


@pytest.mark.parametrize(("sigma_rad", "says"), [(0.5, True), (0.03, False)])
def test_the_head_says_that_a_tilt_left_open_at_the_start_stayed_so(sigma_rad: float, says: bool) -> None:
    pose, covariance = initial_pose_of(SPATIAL)
    analysis = started(pose, without_tilt(covariance), written(SPATIAL))
    (belief,) = analysis.record.beliefs
    wide = np.tile(np.diag([1e-4, 1e-4, 1e-4, sigma_rad**2, 1e-4, 1e-4]), (len(belief.poses), 1, 1))
    record = dataclasses.replace(analysis.record, beliefs=(dataclasses.replace(belief, pose_covariances=wide),))
    told = [line for line in warnings(dataclasses.replace(analysis, record=record), []) if "Gravity was hardly" in line]
    assert ["in the end are known to ± 0.5 rad" in line for line in told] == [True] * says


@pytest.mark.parametrize("settings", ["", "[1", '{"initial_pose": {"mean": ["here"]}}'])
def test_without_a_legible_configuration_no_source_is_claimed(settings: str) -> None:
    analysis = started(*initial_pose_of(PLANAR), settings)
    assert report_document(analysis)["start"]["source"] == ""
    assert said(analysis).endswith("source not recorded")
