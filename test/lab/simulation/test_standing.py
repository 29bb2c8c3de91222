"""The bag of a standing robot: fifty pictures of one view tell hardly more than five; a report compares two runs."""

import json
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from semantic_slam_lab.simulation.annotation import Annotation
from semantic_slam_lab.simulation.detectors.sensor_noise import (
    DEPTH_WINDOW_PX,
    NEAREST_DEPTH_M,
    SensorNoise,
    noisy_boxes,
    noisy_depth_m,
    noisy_image,
)
from semantic_slam_lab.simulation.layout import draw_layout
from semantic_slam_lab.simulation.standing import (
    ROOM_SEED,
    WATCHED,
    StandingSettings,
    detectable,
    standing_place,
    write_standing,
)

from semantic_slam.bag.reader import BagReader
from semantic_slam.cli import bag_to_report
from semantic_slam.inference.world.map_prior import read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.images import decode_depth, decode_image
from semantic_slam.pipeline.preamble import map_prior_path

ROOT = Path(__file__).parents[3]
BAG = ROOT / "bags" / "standing.mcap"
FRAMES = 50
FIRST_VIEWS = 5


def contents(topic: str) -> list[Any]:
    with BagReader(BAG) as reader:
        return [reader.decode(item.cdr, item.type_name) for item in reader.messages([topic])]


def test_the_bag_holds_fifty_frames_of_one_object() -> None:
    assert BAG.stat().st_size < 3_000_000
    detections = [from_message(message) for message in contents(topics.DETECTIONS)]
    truth = [from_message(message) for message in contents(topics.GROUND_TRUTH_ASSOCIATIONS)]
    objects = from_message(contents(topics.GROUND_TRUTH_OBJECTS)[0])
    watched = next(placed for placed in draw_layout(ROOM_SEED) if placed.name == WATCHED)
    assert len(detections) == len(truth) == FRAMES
    assert {frame.object_ids for frame in truth} == {(str(watched.object_id),)}
    assert objects.class_names[objects.object_ids.index(str(watched.object_id))] == watched.class_name
    assert all(second.stamp_ns > first.stamp_ns for first, second in pairwise(detections))


def test_the_robot_stands_and_only_noise_is_new() -> None:
    odometry = [from_message(message) for message in contents(topics.ODOMETRY)]
    assert len(odometry) == FRAMES
    assert {tuple(sample.pose) for sample in odometry} == {(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}
    truth = {tuple(from_message(message).pose) for message in contents(topics.GROUND_TRUTH_ODOMETRY)}
    assert len(truth) == 1
    boxes = np.array([from_message(message).boxes[0] for message in contents(topics.DETECTIONS)])
    size = (boxes[:, 2:] - boxes[:, :2]).mean(axis=0)
    # Edges are off by 1 % of the box: over 50 frames the estimate of that is good to a fifth at three sigma or so.
    assert boxes.std(axis=0) / np.tile(size, 2) == pytest.approx(np.full(4, 0.01), rel=0.4)
    first, second = (decode_image(message, "image") for message in contents(topics.IMAGE_COMPRESSED)[:2])
    assert 1.0 < np.abs(first.astype(float) - second).mean() < 6.0  # sigma 3 in each, less what jpeg smooths
    near, far = (decode_depth(message, "depth") for message in contents(topics.DEPTH_COMPRESSED)[:2])
    both = np.isfinite(near) & np.isfinite(far)
    assert 0.001 < np.abs(near[both] - far[both]).mean() < 0.1


def test_the_start_is_known_and_the_map_lies_beside_the_bag() -> None:
    start = from_message(contents(topics.INITIAL_POSE)[0])
    true = from_message(contents(topics.GROUND_TRUTH_ODOMETRY)[0]).pose
    sigma = np.sqrt(start.covariance[0, 0])
    assert sigma <= 0.03
    assert np.linalg.norm(start.pose[:2] - true[:2]) < 4.0 * sigma
    path = map_prior_path(BAG)
    assert path == BAG.with_name("standing.objects.json")
    prior = read_map_prior(path)
    assert {item.object_id for item in prior.objects} == {placed.object_id for placed in draw_layout(ROOM_SEED)}
    assert not any(item.class_probabilities for item in prior.objects)


def test_a_bare_bags_own_map_prior_comes_before_the_folders(tmp_path: Path) -> None:
    bag = tmp_path / "drive.mcap"
    bag.write_bytes(b"")
    assert map_prior_path(bag) is None
    (tmp_path / "objects.json").write_text("")
    assert map_prior_path(bag) == tmp_path / "objects.json"
    (tmp_path / "drive.objects.json").write_text("")
    assert map_prior_path(bag) == tmp_path / "drive.objects.json"
    assert map_prior_path(tmp_path) == tmp_path / "objects.json"


@pytest.mark.slow
@pytest.mark.render
def test_the_same_seed_writes_the_same_bytes(tmp_path: Path) -> None:
    settings = StandingSettings(num_frames=2, width=160, height=120)
    first, again, other = (
        write_standing(tmp_path / name, seed, settings) for name, seed in (("a", 0), ("b", 0), ("c", 1))
    )
    assert first.read_bytes() == again.read_bytes() != other.read_bytes()
    priors = [path.with_suffix(".objects.json").read_text() for path in (first, again, other)]
    assert priors[0] == priors[1] != priors[2]


def test_the_detector_leaves_out_what_is_far_or_hidden() -> None:
    objects = draw_layout(ROOM_SEED)
    place = standing_place(objects)
    distances = {placed.object_id: np.hypot(placed.x_m - place[0], placed.y_m - place[1]) for placed in objects}
    every = [Annotation(number, (10 * number, 0, 10 * number + 5, 9), 1) for number in sorted(distances, reverse=True)]
    found = [item.object_id for item in detectable(every, objects, place, StandingSettings())]
    assert found == sorted(number for number, distance in distances.items() if distance <= 3.0)
    hidden = [Annotation(item.object_id, item.box, 3) for item in every]
    assert detectable(hidden, objects, place, StandingSettings()) == []


def test_noise_has_the_stated_deviation() -> None:
    rng, noise = np.random.default_rng(1), SensorNoise()
    image = noisy_image(np.full((80, 80, 3), 128, dtype=np.uint8), noise, rng)
    assert image.std() == pytest.approx(noise.sigma_image, rel=0.05)
    side = 60 * DEPTH_WINDOW_PX
    depth = np.full((side, side), 2.4, dtype=np.float32)
    depth[:DEPTH_WINDOW_PX] = np.nan
    measured = noisy_depth_m(depth, noise, rng)
    # sigma = s0 + s2 (z - z0)^2 with z - z0 = 2 m
    expected = noise.sigma_depth_m + noise.sigma_depth_per_m2 * (2.4 - NEAREST_DEPTH_M) ** 2
    assert (measured - depth)[DEPTH_WINDOW_PX:].std() == pytest.approx(expected, rel=0.1)
    assert np.isnan(measured[:DEPTH_WINDOW_PX]).all()
    boxes = noisy_boxes(np.tile([10.0, 20.0, 110.0, 70.0], (4000, 1)), noise, rng)
    assert boxes.std(axis=0) == pytest.approx(noise.sigma_box * np.array([100, 50, 100, 50]), rel=0.1)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """The documented comparison, through the command line."""
    out = tmp_path_factory.mktemp("standing")
    words = ["bag_to_report", BAG, "--out", out, "--config", ROOT / "config" / "standing.yaml"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [*map(str, words), "--compare", str(ROOT / "config" / "standing_independent.yaml")])
        bag_to_report.command()
    yield json.loads((out / "report.json").read_text())


@pytest.mark.long
@pytest.mark.slow
def test_every_frame_becomes_a_keyframe(report: dict[str, Any]) -> None:
    assert report["bag"]["n_keyframes"] == FRAMES == len(report["keyframes"])
    assert report["dropped"] == {}
    assert report["metrics"]["ate_m"] < 0.1


@pytest.mark.slow
def test_correlated_views_say_it_once_and_independent_ones_fifty_times(report: dict[str, Any]) -> None:
    """From view 5 to view 50 at most 1 nat, and at least five times as much when every view counts as new."""
    correlated, independent = report["comparisons"]
    assert (correlated["name"], independent["name"]) == ("standing", "standing_independent")
    kinds = [run["config"]["semantic_model"]["kind"] for run in (correlated, independent)]
    assert kinds == ["gp_correlated", "gp_independent"]
    changes = []
    for run in (correlated, independent):
        (seen,) = run["objects"]
        assert len(seen["log_odds"]) == FRAMES and None not in seen["log_odds"]
        changes.append(abs(seen["log_odds"][-1] - seen["log_odds"][FIRST_VIEWS - 1]))
        assert seen["change_since_view_5"] == pytest.approx(seen["log_odds"][-1] - seen["log_odds"][4])
        # The log-odds are those of the probabilities, as long as these tell.
        first, second = (seen["class_probabilities"][name] for name in seen["classes"])
        assert np.log(first / second) == pytest.approx(seen["log_odds"][-1], rel=1e-6)
    assert changes[0] <= 1.0
    assert changes[1] >= 5.0 * changes[0] and changes[1] >= 5.0
