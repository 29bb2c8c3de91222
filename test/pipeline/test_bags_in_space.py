"""Bags of a camera that flies: all six of odometry and of detections come through, to belief and report."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.simulation.tables import T_BODY_CAMERA, Flight, TableTops, table_tops
from semantic_slam_lab.studies.tables.run import configuration
from worlds.bags.imported import read_bag
from worlds.bags.table_bag import in_space, table_entries, write_table_bag

from semantic_slam.answers.appearances import appearances_of
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.world.map_prior import read_map_prior
from semantic_slam.maps.as_prior import joint_covariance
from semantic_slam.maps.from_run import saved_map_of_bag
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.perception.places import BAD_COVARIANCE, NO_PLACE
from semantic_slam.pipeline.offline import RunSummary, run_bag
from semantic_slam.report.make import make_report

OUTSIDE = "/classifier/measurements: detections outside the region of open_world"


@pytest.fixture(scope="module")
def room() -> TableTops:
    flight = Flight(keyframes=20, things=8)
    return table_tops(flight, SpatialRegion.of(configuration().open_world), np.random.default_rng(5))


@pytest.fixture(scope="module")
def run(room: TableTops, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunSummary]:
    folder = tmp_path_factory.mktemp("flight")
    summary = run_bag(write_table_bag(folder / "bag", table_entries(room)), folder / "belief", in_space())
    return folder / "belief", summary


@pytest.mark.long
def test_all_six_of_odometry_and_whole_points_come_through_a_bag(room: TableTops, run: tuple[Path, RunSummary]) -> None:
    path, summary = run
    recorded = read_bag(path)
    beliefs: list[HybridBelief] = recorded["/hypothesis_manager/belief"]
    assert summary.num_keyframes == len(room.keyframes) and summary.fault is None
    assert summary.dropped == {OUTSIDE: 2}  # at the image's edge, where rays err
    measured = recorded["/classifier/measurements"]
    for own, keyframe in zip(measured, room.keyframes, strict=True):
        np.testing.assert_allclose(own.points, keyframe.measurements.points, atol=1e-12)
        np.testing.assert_allclose(own.sensor_orientation, T_BODY_CAMERA[3:], atol=1e-12)
    assert all(belief.state_space == "spatial" for belief in beliefs)
    heights = [abs(belief.poses[0, 2]) + np.abs(belief.poses[0, 3:5]).max() for belief in beliefs]
    assert max(heights) > 0.05


def test_the_objects_lie_in_space_as_the_things_do(room: TableTops, run: tuple[Path, RunSummary]) -> None:
    """Up to where map begins, which is the first pose."""
    last: HybridBelief = read_bag(run[0])["/hypothesis_manager/belief"][-1]
    found = np.array([item.position for item in last.objects if item.existence > 0.5])
    seen = {n for own in room.seen for n in own if n >= 0}
    assert abs(len(found) - len(seen)) <= 1
    between = np.sort(np.linalg.norm(found[:, None] - found, axis=-1), axis=None)[-4]
    things = room.things[sorted(seen)]
    assert between == pytest.approx(np.sort(np.linalg.norm(things[:, None] - things, axis=-1), axis=None)[-4], abs=0.1)


def test_the_map_of_a_run_in_space_holds_where_its_objects_are(run: tuple[Path, RunSummary]) -> None:
    """And what they have in common: inferred again from the bag of its belief."""
    last: HybridBelief = read_bag(run[0])["/hypothesis_manager/belief"][-1]
    known = saved_map_of_bag(run[0])
    assert known.state_space == "spatial" and known.has_cross_covariances
    np.testing.assert_allclose(known.objects.poses[:, :3], last.object_poses[:, :3], atol=1e-9)
    own = np.einsum("iaib->iab", joint_covariance(known).reshape(len(known.objects), 3, len(known.objects), 3))
    np.testing.assert_allclose(own, last.object_covariances[:, :3, :3], atol=1e-9)


@pytest.mark.long
def test_what_cannot_be_used_in_space_is_counted(room: TableTops, tmp_path: Path) -> None:
    entries = table_entries(room)
    first, second, *_ = (
        entry.message for entry in entries if entry.topic == topics.DETECTIONS and len(entry.message.labels) > 1
    )
    first.positions[:3] = np.nan
    second.position_covariances[:9] = -np.eye(3).ravel()
    summary = run_bag(write_table_bag(tmp_path / "bag", entries), tmp_path / "belief", in_space())
    assert summary.dropped == {OUTSIDE: 2, NO_PLACE: 1, BAD_COVARIANCE: 1}


@pytest.mark.long
def test_what_was_seen_is_found_by_another_picture_of_it(room: TableTops, tmp_path: Path) -> None:
    """By vectors that detections carry, with what is not there as unknown; the report has the run's descriptors."""
    random = np.random.default_rng(7)
    looks = random.normal(size=(len(room.things) + 1, 100))
    entries = table_entries(room)
    told = (entry for entry in entries if entry.topic == topics.DETECTIONS)
    for entry, numbers in zip(told, room.seen, strict=True):
        found, shown = from_message(entry.message), [n if n >= 0 else len(room.things) for n in numbers]
        vectors = looks[shown] + random.normal(0.0, 0.3, (len(shown), 100))
        entry.message = to_message(replace(found, embeddings=vectors))
    settings = replace(in_space(), semantic_model=SemanticModelConfiguration(kind="embedding"))
    assert run_bag(write_table_bag(tmp_path / "bag", entries), tmp_path / "belief", settings).fault is None
    record = read_record(tmp_path / "belief")
    looked = appearances_of(record.beliefs, record.measurements, settings.semantic_model)
    last, seen = record.beliefs[-1], sorted({n for own in room.seen for n in own if n >= 0})
    best = [find_objects(last, Question(vector=looks[n]), looked) for n in seen]
    sure = [found.objects[0] for found in best if found.objects[0].probability > 0.9]
    assert len(sure) >= 0.8 * len(seen) and len({found.object_id for found in sure}) == len(sure)
    assert find_objects(last, Question(vector=random.normal(size=100)), looked).unknown > 0.5
    make_report(tmp_path / "belief", tmp_path / "report")
    prior = read_map_prior(tmp_path / "report" / "objects.json")
    assert prior.descriptor_space == "embedding-128" and len(prior.objects[0].descriptor) == 128
