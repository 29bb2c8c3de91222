"""From a user's own bag to a report: ids from the detector, ids from a map, and bearings only."""

import json
import sys

import numpy as np
import pytest
from worlds.bags.bag_factory import write_configuration
from worlds.bags.imported import run_import
from worlds.bags.user_bag_factory import write_drive

from semantic_slam.cli import bag_to_report
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

CUP, BOTTLE = [3.1, -0.5], [3.1, 0.6]
"""Where write_drive puts them in map [m]: ahead of the first pose, to the right and to the left."""
FLAT = {"depth_to_width": 0.0}
"""They are as flat as the depth images show them."""


def import_drive(monkeypatch, folder, **drive):
    """The imported bag of a drive."""
    source, bag = write_drive(folder / "source", **drive), folder / "bag"
    run_import(monkeypatch, "bag", source, "--out", bag)
    return bag


def make_report(monkeypatch, bag, out, configuration, *words):
    """The report.json of a bag."""
    command = ["bag_to_report", bag, "--out", out, "--config", configuration, *words]
    monkeypatch.setattr(sys, "argv", [str(word) for word in command])
    bag_to_report.command()
    assert (out / "report.html").stat().st_size > 10_000
    return json.loads((out / "report.json").read_text())


def positions(report):
    return {item["name"]: item["pose"][:2] for item in report["objects"]}


def test_vision_msgs_with_ids_create_objects(tmp_path, monkeypatch):
    bag = import_drive(monkeypatch, tmp_path, track_ids=("7", "b"))
    configuration = write_configuration(tmp_path / "configuration", association="given", perception=FLAT)
    report = make_report(monkeypatch, bag, tmp_path / "out", configuration)
    assert [keyframe["n_detections"] for keyframe in report["keyframes"]] == [2] * 6
    found = positions(report)
    assert found.keys() == {"7", "b"}
    np.testing.assert_allclose([found["7"], found["b"]], [CUP, BOTTLE], atol=0.1)


def test_yolo_msgs_without_ids_are_associated_with_a_map(tmp_path, monkeypatch):
    bag = import_drive(monkeypatch, tmp_path, detector="yolo", track_ids=("", ""))
    covariance = np.diag([0.05, 0.05, 1e-6, 1e-6, 1e-6, 0.01])
    poses = {4: np.array([*CUP, 0, 0, 0, 0, 1.0]), 9: np.array([*BOTTLE, 0, 0, 0, 0, 1.0])}
    prior = MapPrior(
        tuple(
            ObjectPrior(object_id=n, name=f"object {n}", pose=pose, covariance=covariance, class_probabilities={})
            for n, pose in poses.items()
        )
    )
    (tmp_path / "objects.json").write_text(prior.to_json())
    configuration = write_configuration(tmp_path / "configuration", perception=FLAT)
    words = ("--map-prior", tmp_path / "objects.json")
    report = make_report(monkeypatch, bag, tmp_path / "out", configuration, *words)
    assert [keyframe["best"]["associations"] for keyframe in report["keyframes"]] == [[4, 9]] * 6


@pytest.mark.long
@pytest.mark.slow
def test_bearings_alone_place_objects(tmp_path, monkeypatch):
    bag = import_drive(monkeypatch, tmp_path, depth="", frames=20)
    configuration = write_configuration(
        tmp_path / "configuration",
        association="given",
        perception={"sigma_bearing_rad": 0.01},
        new_objects={"range_m": 6.0},  # twice the truth: the distance has to come from the motion
    )
    found = positions(make_report(monkeypatch, bag, tmp_path / "out", configuration))
    np.testing.assert_allclose([found["a"], found["b"]], [CUP, BOTTLE], atol=0.25)


def test_a_camera_on_a_joint_of_tf_sees_as_a_fixed_one(tmp_path, monkeypatch):
    bag = import_drive(monkeypatch, tmp_path, joints=[("base_link", "head")], track_ids=("7", "b"))
    configuration = write_configuration(tmp_path / "configuration", association="given", perception=FLAT)
    found = positions(make_report(monkeypatch, bag, tmp_path / "out", configuration))
    np.testing.assert_allclose([found["7"], found["b"]], [CUP, BOTTLE], atol=0.1)
