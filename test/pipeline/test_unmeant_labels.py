"""A label that a live detector sends later, and that a network's classes cannot mean, is no evidence of one of them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import SPEED_M, frame_stamp, map_prior, odometry
from worlds.bags.places import relative_positions
from worlds.processes.node_runs import assert_same

from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.sensor import IDENTITY
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.recorded_keyframes import recorded_keyframes
from semantic_slam.pipeline.session import Session
from semantic_slam.pipeline.unmeant_labels import UnmeantLabels
from semantic_slam.reasons import MOST_REASONS, OTHER
from semantic_slam.ros.node.health import Level, dropped_status

FIVE = ("cabinet", "chest", "crate", "desk", "locker")
NUM_FRAMES = 5
REASON = f"{topics.MEASUREMENTS}: unknown label 'refrigerator'"
NETWORK = Configuration()
DETECTOR = Configuration.of(semantic_model={"kind": "detector", "labels": (*FIVE, "refrigerator")}, association="open")


def measured(k: int, *others: str) -> SemanticMeasurements:
    """The two things of the map, which the network takes for cabinets, and others beside them of which it does too."""
    near = relative_positions(k)[:, :2]
    places = np.vstack([near, *(near[:1] + np.array([0.0, 0.5 + n]) for n in range(len(others)))])
    count = len(places)
    scores = np.tile([0.8, 0.05, 0.05, 0.05, 0.05], (count, 1))
    return SemanticMeasurements(
        stamp_ns=frame_stamp(k), sequence=k, frame_id="base_link", class_names=FIVE,
        detection_ids=np.arange(count, dtype=np.uint32), boxes=np.full((count, 4), np.nan),
        labels=("cabinet", "object", *others), scores=np.full(count, 0.9), track_ids=("",) * count,
        class_probability_samples=np.repeat(scores[:, None], 2, axis=1), features=scores,
        feature_covariances=np.tile(0.01 * np.eye(5), (count, 1, 1)), predictive_entropy=np.zeros(count),
        mutual_information=np.zeros(count), ranges_m=np.linalg.norm(places, axis=1),
        bearings_rad=np.arctan2(places[:, 1], places[:, 0]),
        geometric_covariances=np.tile(0.01 * np.eye(2), (count, 1, 1)), sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=bool),
    )  # fmt: skip


def live(session: Session, others: Mapping[int, tuple[str, ...]]) -> list[HybridBelief]:
    """Beliefs of a session that hears frame after frame; ``others``: labels beside those of the map, by frame."""
    pool, found = InProcessPool(1), []
    session.assembler.add_odometry(to_message(odometry(frame_stamp(-1), -SPEED_M)))
    for k in range(NUM_FRAMES):
        session.assembler.add_odometry(to_message(odometry(frame_stamp(k), SPEED_M * k)))
        session.assembler.add_measurements(measured(k, *others.get(k, ())))
        found += [belief for _, belief in session.beliefs(pool)]
    return found + [belief for _, belief in session.beliefs(pool, at_end=True)]


@pytest.mark.parametrize("association", ["enumerated", "open"])
def test_what_it_names_is_left_out_and_counted_and_said_once(association: str) -> None:
    """The belief is that of a drive on which it was never seen."""
    configuration = replace(NETWORK, association=association)
    session, without = (Session(configuration, map_prior(), "") for _ in range(2))
    found = live(session, {2: ("refrigerator",), 3: ("refrigerator", "refrigerator"), 4: ("desk",)})
    assert_same(found, live(without, {4: ("desk",)}))
    assert len(found) == NUM_FRAMES and len(found[3].detection_ids) == 2
    status = dropped_status(session.dropped - without.dropped)
    assert status.level == Level.WARN and status.values == {f"dropped: {REASON}": "3"}
    (line,) = session.news()
    assert "'refrigerator'" in line and "config/detector.yaml" in line and "cabinet" in line
    assert session.news() == without.news() == []


def test_of_ever_new_labels_a_hundred_are_said_and_counted_by_name_and_the_others_together() -> None:
    told = measured(0, *(f"{n:03}{'x' * 1000}" for n in range(MOST_REASONS + 50)))
    keyframe = Keyframe(
        index=0, stamp_ns=told.stamp_ns, odometry=IDENTITY, odometry_covariance=np.eye(6), measurements=told
    )
    unmeant = UnmeantLabels(NETWORK)
    assert unmeant.without(keyframe).measurements.labels == ("cabinet", "object")
    assert len(unmeant.news()) == len(unmeant.dropped) == MOST_REASONS + 1 and unmeant.dropped[OTHER] == 50
    assert max(map(len, unmeant.dropped)) < 200


def test_at_the_start_it_still_ends_the_run() -> None:
    with pytest.raises(InputError, match="labelled 'refrigerator', which is none of the classes"):
        live(Session(NETWORK, map_prior(), ""), {0: ("refrigerator",)})


def test_what_perception_leaves_out_and_a_detectors_own_words_are_no_concern_of_it() -> None:
    listed = replace(NETWORK, perception=replace(NETWORK.perception, labels=("cabinet", "object")))
    for configuration in (listed, DETECTOR):
        session = Session(configuration, map_prior(), "")
        last = live(session, {2: ("refrigerator",)})[2]
        assert len(last.detection_ids) == 3 and not session.news() and REASON not in session.dropped


def test_a_recorded_run_is_replayed_without_it_too(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "belief") as writer:
        writer.write(topics.ODOMETRY, to_message(odometry(frame_stamp(-1), -SPEED_M)), frame_stamp(-1))
        for k in range(NUM_FRAMES):
            writer.write(topics.ODOMETRY, to_message(odometry(frame_stamp(k), SPEED_M * k)), frame_stamp(k))
            others = ("refrigerator", "desk") if k == 2 else ()
            writer.write(topics.MEASUREMENTS, to_message(measured(k, *others)), frame_stamp(k))
    found = recorded_keyframes(tmp_path / "belief", NETWORK, NUM_FRAMES)
    told = [keyframe.measurements.labels for keyframe in found]
    assert told == [("cabinet", "object")] * 2 + [("cabinet", "object", "desk")] + [("cabinet", "object")] * 2
    assert found[2].measurements.detection_ids.tolist() == [0, 1, 3]
