"""Reports of runs in space: the map that is turned by hand, its numbers, and that the page stays one file."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, START, measurements_at, run_configuration, small_belief, write_rows

from semantic_slam.geometry import se3, so3
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.spatial.camera import Camera
from semantic_slam.messages import topics
from semantic_slam.perception.image_sight import ImageSight
from semantic_slam.report.make import make_report
from semantic_slam.report.shown.keyframe import keyframe_scene
from semantic_slam.report.shown.space import camera_pyramid, principal_axes
from semantic_slam.view.live_run import LiveRun

HOSTILE = "<script>alert('x')</script>"
TILTED = np.array([0.5, -0.2, 1.4, *so3.exp(np.array([0.3, -0.4, 1.0]))])
POINT = np.diag([0.04, 0.01, 0.09, 0.0, 0.0, 0.0])
IN_SPACE = {"planar": False, "state_space": "spatial"}
AFTER_CLASSES = 8 + len(CLASSES)
"""Place in the row of an object of what it has in space alone: place, x, y, yaw, ellipse, sigma of yaw, classes."""


def in_space() -> HybridBelief:
    """One hypothesis, a point at a height of 0.8 m, and one that hardly exists."""
    base = small_belief(0, [1], [0], [1.0], [3, 4], [[0]])
    poses = np.tile([1.0, 2.0, 0.8, 0.0, 0.0, 0.0, 1.0], (2, 1))
    return dataclasses.replace(
        base,
        **IN_SPACE,
        poses=TILTED[None],
        pose_covariances=np.stack([np.diag([0.01, 0.02, 0.03, 1e-4, 1e-4, 1e-4])]),
        object_poses=poses,
        object_covariances=np.stack([POINT, POINT]),
        object_names=(HOSTILE, "4"),
        existence=np.array([1.0, 0.2]),
    )


def scene_of(text: str) -> dict[str, Any]:
    data = re.search(r'<script type="application/json" id="scene">(.*?)</script>', text, re.S)
    assert data is not None
    return json.loads(data[1])


def report(folder: Path, belief: HybridBelief) -> str:
    run = run_configuration(folder, CLASSES, ("",) * 7)
    rows = [(topics.RUN_CONFIGURATION, START, run), (topics.BELIEF, START, belief)]
    write_rows(folder / "bag", [*rows, (topics.MEASUREMENTS, START, measurements_at(0, [0], CLASSES))])
    make_report(folder / "bag", folder / "report")
    return (folder / "report" / "report.html").read_text()


def test_principal_axes_make_up_the_covariance() -> None:
    root = np.random.default_rng(2).normal(size=(4, 6, 6))
    covariances = root @ root.swapaxes(1, 2)
    axes = principal_axes(covariances).reshape(4, 3, 3)
    np.testing.assert_allclose(axes.swapaxes(1, 2) @ axes, covariances[:, :3, :3], atol=1e-12)
    assert (np.diff(np.linalg.norm(axes, axis=2)) >= 0.0).all()
    unknown = covariances.copy()
    unknown[1] = np.nan
    assert np.isnan(principal_axes(unknown)).any(axis=1).tolist() == [False, True, False, False]


def test_the_pyramid_is_what_the_camera_sees() -> None:
    """A camera that looks along x: 90 degrees wide, so a metre ahead its picture reaches a metre to either side."""
    told = {"field_of_view_rad": np.pi / 2, "vertical_field_of_view_rad": 2.0 * np.arctan(0.5)}
    corners = camera_pyramid(Camera(), told)
    np.testing.assert_allclose(corners[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(corners[1:], [[1, 1, 0.5], [1, -1, 0.5], [1, -1, -0.5], [1, 1, -0.5]], atol=1e-12)
    everywhere = camera_pyramid(Camera(), {"field_of_view_rad": 2.0 * np.pi})
    assert np.isfinite(everywhere).all() and np.abs(everywhere).max() < 3.0


def test_the_pyramid_has_the_edges_of_the_image_where_they_are_known() -> None:
    """An image whose middle is off the optical axis: 45 degrees to the left and none to the right, all above."""
    edges = np.array([[-np.pi / 4, 0.0], [-np.arctan(0.5), 0.0]])
    sight = ImageSight(edges, np.zeros((0, 0)))
    corners = camera_pyramid(Camera(sight=sight), {"field_of_view_rad": 1.0})
    np.testing.assert_allclose(corners[1:], [[1, 1, 0.5], [1, 0, 0.5], [1, 0, 0], [1, 1, 0]], atol=1e-12)
    wide = camera_pyramid(Camera(sight=ImageSight(2.0 * edges, np.zeros((0, 0)))), {})
    assert np.isfinite(wide).all() and np.abs(wide).max() < 3.0


def test_rows_go_on_with_height_attitude_and_ellipsoid() -> None:
    belief = in_space()
    row = keyframe_scene(belief, START, [], {3: 0, 4: 1}, {})["o"][0]
    assert row[AFTER_CLASSES] == 0.8 and len(row) == AFTER_CLASSES + 10
    np.testing.assert_allclose(np.reshape(np.abs(row[-9:]), (3, 3)), [[0, 0.1, 0], [0.2, 0, 0], [0, 0, 0.3]])
    assert row[7] > 1.0  # a point has no heading to draw
    planar = keyframe_scene(small_belief(0, [1], [0], [1.0], [3], [[0]]), START, [], {3: 0}, {})["o"][0]
    assert len(planar) == AFTER_CLASSES and planar[7] < 1.0


def test_rows_of_places_go_on_with_height_and_ellipsoid() -> None:
    """A point that is at a height of 0.8 m, or on the floor below."""
    places = np.array([[1.0, 2.0, 0.8], [1.0, 2.0, 0.0]])
    several = {"place_objects": np.array([0, 0], dtype=np.uint32), "place_probabilities": np.array([0.6, 0.4])}
    several |= {"place_means": places, "place_covariances": np.stack([POINT[:3, :3], 4.0 * POINT[:3, :3]])}
    rows = keyframe_scene(dataclasses.replace(in_space(), **several), START, [], {3: 0, 4: 1}, {})["p"]
    np.testing.assert_allclose([row[:4] for row in rows], [[0, 0.6, 1, 2], [0, 0.4, 1, 2]])
    assert [row[7] for row in rows] == [0.8, 0.0]
    np.testing.assert_allclose(np.reshape(np.abs(rows[1][8:]), (3, 3)), [[0, 0.2, 0], [0.4, 0, 0], [0, 0, 0.6]])


def test_the_page_of_a_run_in_space_turns_its_map(tmp_path: Path) -> None:
    text = report(tmp_path, in_space())
    scene = scene_of(text)
    assert text.count("<canvas") == 1 and "class SpaceView" in text and "x, y, z [m]" in text
    assert text.count("<script") == 2 and "http" not in "".join(re.findall(r'(?:src|href)="([^"]*)"', text))
    assert HOSTILE not in text and HOSTILE in scene["objects"][0]["label"]
    hypothesis = scene["frames"][0]["h"][0]
    np.testing.assert_allclose(hypothesis[8:13], TILTED[2:], atol=1e-4)
    assert scene["frames"][0]["e"] == [[1, 0.2]] and len(scene["camera"]) == 5


def test_a_page_of_the_plane_has_no_such_map(tmp_path: Path) -> None:
    text = report(tmp_path, small_belief(0, [1], [0], [1.0], [3], [[0]]))
    assert "<canvas" not in text and "SpaceView(" in text and "class SpaceView" not in text
    assert scene_of(text)["camera"] == []


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.2, 0.5, -0.3])])
def test_a_page_that_follows_a_run_in_space_has_the_camera_where_it_is_mounted(turn: np.ndarray) -> None:
    mount = se3.compose(np.array([0.1, 0.0, 0.2, *so3.exp(turn)]), Camera().T_body_camera)
    run = LiveRun()
    seen = dataclasses.replace(
        measurements_at(0, [0], CLASSES), sensor_position=mount[:3], sensor_orientation=mount[3:]
    )
    run.add_measurements(seen)
    assert run.changes("", 0)["camera"] is None
    run.add_belief(in_space())
    np.testing.assert_allclose(run.changes("", 0)["camera"], camera_pyramid(Camera(mount), {}), atol=6e-4)
