"""The doctor finds each mistake that is planted into a small bag, alone, and its remedy; without one it is silent."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.bags.bag_factory import HEIGHT, WIDTH, input_entries, map_prior, without, write_bag
from worlds.bags.mistakes import (
    Entries,
    beside_positions,
    doubled,
    each,
    emptied,
    every_other,
    jumped,
    of_another_model,
    of_lidar,
    on_tf,
    one_ahead,
    other_labels,
    raw_depth,
    renamed,
    retyped,
    rotated,
    scaled_boxes,
    scored,
    set_back,
    shift,
    silent,
    sparse,
    swapped,
    varied,
)
from worlds.bags.places import place_entries, told_by_sensor
from worlds.bags.stereo import by_stereo

from semantic_slam.configuration import from_dict
from semantic_slam.doctor.bag_summary import summarise_bag
from semantic_slam.doctor.examination import examine
from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics

FRAMES = 24
NONE = {"semantic_model": {"kind": "none"}}


@dataclass(frozen=True)
class Mistake:
    """What is done to the small bag, or to its configuration, and what the doctor has to say."""

    name: str
    check: str
    words: tuple[str, ...]  # in what is wrong and in the remedy
    plant: Callable[[Entries], Entries] = field(default=lambda entries: entries)
    configuration: dict[str, Any] = field(default_factory=lambda: NONE)
    prior: Callable[[], MapPrior] = map_prior
    severity: Severity = Severity.ERROR


def examined(folder: Path, entries: Entries, configuration: dict[str, Any], prior: MapPrior) -> list[Finding]:
    summary, faults = summarise_bag(write_bag(folder / "bag", entries), from_dict(configuration), prior)
    return [*faults, *examine(summary)]


DETECTOR = {"semantic_model": {"kind": "detector"}, "association": "open"}
PARAMETRIC = {"semantic_model": {"kind": "parametric", "class_names": ["crate", "chest"]}}
MISTAKES = [
    Mistake("a topic that is missing", "topics", ("no topic odom", "record it"), lambda e: without(e, topics.ODOMETRY)),
    Mistake("a topic under another name", "topics", ("no topic odom", "/wheel_odometry", "import bag"), renamed),
    Mistake("odometry on /tf alone", "topics", ("no topic odom", "with --odom /tf"), on_tf),
    Mistake(
        "depth without pictures",
        "topics",
        ("/depth/compressed is not used", "bearings alone", "record colour pictures, too"),
        lambda e: without(e, topics.IMAGE_COMPRESSED),
        severity=Severity.WARNING,
    ),
    Mistake("a topic of another type", "topics", ("/odom is geometry_msgs", "import bag converts"), retyped),
    Mistake(
        "odometry that stops",
        "clocks",
        ("lie outside the time of /odom", "whole drive"),
        silent,
        severity=Severity.WARNING,
    ),
    Mistake(
        "intrinsics of another size",
        "intrinsics",
        ("160 x 120 and camera_info says 320 x 240", "scaled as they are"),
        each(topics.CAMERA_INFO, lambda m: (setattr(m, "width", 320), setattr(m, "height", 240))),
    ),
    Mistake(
        "intrinsics that were not scaled with the picture",
        "intrinsics",
        ("do not fit a picture of 160 x 120", "scale fx, fy, cx and cy"),
        each(topics.CAMERA_INFO, lambda m: setattr(m, "k", m.k * np.array([4, 1, 4, 1, 4, 4, 1, 1, 1.0]))),
    ),
    Mistake(
        "a lens with six coefficients",
        "dropped",
        ("the distortion D is not 4, 5, 8, 12 or 14 finite numbers", "calibrate the camera"),
        each(topics.CAMERA_INFO, lambda m: setattr(m, "d", np.full(6, 0.01))),
    ),
    Mistake(
        "disparities beside a camera_info with the lens's distortion",
        "intrinsics",
        ("disparities are of rectified ones", "set perception.rectified: true"),
        lambda e: by_stereo(each(topics.CAMERA_INFO, lambda m: setattr(m, "d", np.array([0.01, 0, 0, 0, 0.0])))(e)),
        severity=Severity.WARNING,
    ),
    Mistake("32FC1 depth in millimetres", "depth", ("median of", "divide it by 1000"), raw_depth(1000.0, "32FC1")),
    Mistake("16UC1 depth in metres", "depth", ("median of 0.00", "multiply it by 1000"), raw_depth(1.0, "16UC1")),
    Mistake(
        "the transform of the camera's body, not of its optical frame",
        "extrinsics",
        ("looks up", "optical frame"),
        each(topics.TF_STATIC, rotated(0.0, 0.0, 0.0, 1.0)),
    ),
    Mistake(
        "no transform from base to camera",
        "extrinsics",
        ("no transform from 'base_link' to the camera 'camera_optical_frame'", "publish /tf_static"),
        lambda e: without(e, topics.TF_STATIC),
    ),
    Mistake(
        "odometry of another body",
        "frames",
        ("of 'base_footprint' where perception.base_frame is 'base_link'", "set perception.base_frame: base_footprint"),
        each(topics.ODOMETRY, lambda m: setattr(m, "child_frame_id", "base_footprint")),
    ),
    Mistake(
        "frames of odometry exchanged",
        "frames",
        ("25 of 25", "exchange header.frame_id"),
        each(topics.ODOMETRY, swapped),
    ),
    Mistake(
        "detections of another frame",
        "frames",
        ("of 'lidar' and the camera is", "copy the image's header"),
        each(topics.DETECTIONS, of_lidar),
    ),
    Mistake(
        "positions of a sensor that nobody has placed",
        "frames",
        ("of frame 'camera_optical_frame'", "(24 of the first 24 messages", "publish /tf_static"),
        lambda _: told_by_sensor(place_entries("positions", FRAMES), is_mounted=False),
    ),
    Mistake(
        "ranges of another frame",
        "frames",
        ("of frame 'lidar' by range and bearing", "state these from the body"),
        lambda _: each(topics.DETECTIONS, of_lidar)(place_entries("ranges", FRAMES)),
    ),
    Mistake(
        "boxes of another frame beside positions",
        "frames",
        ("24 of 24 messages of /detections are of 'lidar' and the camera is", "copy the image's header"),
        lambda entries: each(topics.DETECTIONS, of_lidar)(beside_positions(entries)),
    ),
    Mistake(
        "a detector that finds nothing",
        "dropped",
        ("no detection in 24 messages of /detections, so no keyframe", "correct the detector"),
        each(topics.DETECTIONS, emptied),
    ),
    Mistake(
        "labels that no class means",
        "labels",
        ("labelled 'teapot'", "semantic_model.kind: detector"),
        each(topics.DETECTIONS, other_labels),
        PARAMETRIC,
    ),
    Mistake(
        "a list of labels that the detector does not have",
        "labels",
        ("perception.labels (Chair)", "as it writes them"),
        configuration={**NONE, "perception": {"labels": ["Chair"]}},
    ),
    Mistake(
        "boxes from 0 to 1",
        "boxes",
        ("first pixel", "multiply x"),
        each(topics.DETECTIONS, scaled_boxes(1 / WIDTH, 1 / HEIGHT)),
    ),
    Mistake(
        "a detector without non-maximum suppression",
        "boxes",
        ("24 of 24 messages", "overlap by more than 0.7", "turn on non-maximum suppression"),
        each(topics.DETECTIONS, doubled),
        severity=Severity.WARNING,
    ),
    Mistake(
        "boxes that are not finite",
        "boxes",
        ("48 of 48 boxes are not finite", "x_min y_min x_max y_max"),
        each(topics.DETECTIONS, scaled_boxes(np.nan, 1.0)),
    ),
    Mistake(
        "boxes of a larger picture",
        "boxes",
        ("reach outside", "scale the boxes"),
        each(topics.DETECTIONS, scaled_boxes(4, 4)),
    ),
    Mistake(
        "a clock that is hours ahead",
        "clocks",
        ("outside the time of /odom", "synchronise the clocks"),
        each(topics.ODOMETRY, shift(-7200.0)),
    ),
    Mistake("one odometry stamp that leaps", "stamps", ("leaps ahead", "second publisher"), one_ahead),
    Mistake("odometry that begins anew", "stamps", ("its clock was set back", "cut the recording"), set_back),
    Mistake(
        "odometry that jumps",
        "odometry",
        ("jumps in 1 of 24 steps", "by 40 m and 0 deg in 0.5 s", "REP 105"),
        jumped,
        severity=Severity.WARNING,
    ),
    Mistake(
        "odometry in millimetres",
        "odometry",
        ("jumps in 24 of 24 steps", "poses in metres"),
        each(topics.ODOMETRY, lambda m: setattr(m.pose.pose.position, "x", 1000.0 * m.pose.pose.position.x)),
    ),
    Mistake("odometry that is too slow", "rates", ("every 2 s", "0.5 s", "full rate"), sparse),
    Mistake(
        "detections of no picture",
        "matching",
        ("no /image/compressed within", "copy the image's stamp"),
        each(topics.DETECTIONS, shift(0.1)),
    ),
    Mistake(
        "depth that is stamped late",
        "matching",
        ("24 of 24 messages of /detections have no /depth/compressed", "set perception.sync_tolerance_s: 0.036"),
        each(topics.DEPTH_COMPRESSED, shift(0.03)),
        severity=Severity.WARNING,
    ),
    Mistake(
        "depth with every other picture",
        "matching",
        ("12 of 24 messages of /detections have no /depth/compressed", "record depth with every picture"),
        every_other(topics.DEPTH_COMPRESSED),
        severity=Severity.WARNING,
    ),
    Mistake(
        "scores that are all 0",
        "scores",
        ("all 48 scores are 0", "fill in"),
        each(topics.DETECTIONS, scored(0.0)),
        DETECTOR,
    ),
    Mistake(
        "scores that are all 1",
        "scores",
        ("all 48 scores are 1", "fill in"),
        each(topics.DETECTIONS, scored(1.0)),
        DETECTOR,
        severity=Severity.WARNING,
    ),
    Mistake(
        "odometry without noise",
        "noise",
        ("of the way", "semantic_slam calibrate"),
        configuration={**NONE, "odometry": {"sigma_translation_per_m": 0.0, "sigma_translation_floor_m": 1e-6}},
    ),
    Mistake(
        "a map of other classes",
        "map prior",
        ("1 of 2 objects have classes (fridge)", "same class models"),
        each(topics.DETECTIONS, lambda m: setattr(m, "labels", ["crate"] * len(m.labels))),
        PARAMETRIC,
        of_another_model,
    ),
    Mistake(
        "a configuration that needs a map where there is none",
        "configuration",
        ("no map prior", "association: open"),
        prior=MapPrior,
    ),
    Mistake(
        "a configuration that needs vectors of a detector that has none",
        "configuration",
        ("carries an embedding", "semantic_model.kind: detector"),
        configuration={"association": "open", "semantic_model": {"kind": "embedding"}},
    ),
    Mistake(
        "a configuration that needs labels and vectors of a detector that has labels alone",
        "configuration",
        ("detector_embedding", "carries an embedding", "semantic_model.kind: detector"),
        each(topics.DETECTIONS, varied),
        configuration={"association": "open", "semantic_model": {"kind": "detector_embedding"}},
    ),
    Mistake(
        "a configuration that needs class scores of places that have none",
        "configuration",
        ("no class scores", "the class models know cabinet", "semantic_model.kind: none"),
        lambda _: place_entries("ranges"),
        configuration={},
    ),
    Mistake(
        "a configuration that needs identities that nobody gives",
        "dropped",
        ("carry no track_ids", "association: enumerated"),
        lambda e: without(e, topics.GROUND_TRUTH_ASSOCIATIONS),
        {**NONE, "association": "given"},
    ),
]


@pytest.mark.parametrize("configuration", [NONE, DETECTOR, {**NONE, "association": "open"}])
def test_a_bag_without_a_mistake_is_healthy(tmp_path: Path, configuration: dict[str, Any]) -> None:
    entries = each(topics.DETECTIONS, varied)(input_entries(FRAMES))
    assert examined(tmp_path, entries, configuration, map_prior()) == []


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.name)
def test_each_mistake_is_found_alone_with_its_remedy(tmp_path: Path, mistake: Mistake) -> None:
    entries = mistake.plant(input_entries(FRAMES))
    found = examined(tmp_path, entries, mistake.configuration, mistake.prior())
    print([finding.line for finding in found])
    assert [(finding.check, finding.severity) for finding in found] == [(mistake.check, mistake.severity)]
    assert all(words in found[0].line for words in mistake.words)
    assert "\n" not in found[0].line and found[0].remedy


def test_the_tolerance_that_late_depth_is_given_brings_it_back(tmp_path: Path) -> None:
    entries = each(topics.DEPTH_COMPRESSED, shift(0.03))(input_entries(FRAMES))
    wider = {**NONE, "perception": {"sync_tolerance_s": 0.036}}
    assert examined(tmp_path, entries, wider, map_prior()) == []


def test_topics_are_called_what_they_are_remapped_to() -> None:
    names = {"/odom": "/robot1/odom", "/image": "/robot1/image", "/image/compressed": "/camera/jpeg"}
    said = Finding(
        Severity.ERROR, "topics", "no /image/compressed beside /odom, /my/odom and /odometry", "-r odom:=/odom"
    )
    told = said.renamed(names)
    assert told.what == "no /camera/jpeg beside /robot1/odom, /my/odom and /odometry"
    assert told.remedy == "-r odom:=/robot1/odom" and said.renamed({}) == said
