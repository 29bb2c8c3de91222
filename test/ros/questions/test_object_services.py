"""What the manager's services say of the newest belief, and of questions that cannot be answered."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from semantic_slam_lab.studies.embeddings.known_map import map_of
from semantic_slam_msgs.srv import FindObjects, GetObject, GetPath, QueryPlace, SaveMap
from worlds.bags.places import place_entries
from worlds.bags.vectors import LOOKS, looking, run
from worlds.belief_updates import update_of
from worlds.scenes.small_map import LOOSE, run_to_its_end

from semantic_slam.answers.appearances import appearances_of
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.map_file import read_map
from semantic_slam.messages import topics
from semantic_slam.messages.standard import PoseEstimate
from semantic_slam.messages.typestore import deserialize
from semantic_slam.ros.publishing import path_publisher
from semantic_slam.ros.services.in_background import InBackground
from semantic_slam.ros.services.map_service import MapService
from semantic_slam.ros.services.object_services import ObjectServices
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import receive

pytestmark = pytest.mark.ros

Ask = Callable[[Any, str, Any], Any]


@pytest.fixture
def asked() -> Iterator[tuple[Node, Ask]]:
    """A node, and what asks its services."""
    rclpy.init()
    node, executor = rclpy.create_node("hypothesis_manager"), SingleThreadedExecutor()
    executor.add_node(node)

    def ask(kind: Any, name: str, request: Any) -> Any:
        client = node.create_client(kind, f"~/{name}")
        assert client.wait_for_service(timeout_sec=120.0)
        future = client.call_async(request)
        executor.spin_until_future_complete(future, timeout_sec=120.0)
        return future.result()

    try:
        yield node, ask
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()


def test_the_path_is_told_whole_and_published_in_part(asked: tuple[Node, Ask], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path_publisher, "NEWEST", 2)
    node, ask = asked
    path = path_publisher.PathPublisher(node, "robot1/map")
    sent: list[Any] = []
    receive(node, topics.PATH, lambda data: sent.append(deserialize(data, "nav_msgs/msg/Path")), qos.latched())
    for k in range(4):
        pose = np.array([float(k), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        path.publish(PoseEstimate(1_500_000_000 * (k + 1), "map", pose, np.eye(6)))
    told = ask(GetPath, "get_path", GetPath.Request()).poses
    assert [own.pose.position.x for own in told] == [0.0, 1.0, 2.0, 3.0]
    header = told[0].header
    assert (header.stamp.sec, header.stamp.nanosec, header.frame_id) == (1, 500_000_000, "robot1/map")
    assert sent[-1].header.frame_id == "robot1/map"
    assert [own.pose.position.x for own in sent[-1].poses] == [2.0, 3.0]


def services_of(node: Node) -> ObjectServices:
    return ObjectServices(node, InBackground(node, "services"), SemanticModelConfiguration())


def test_objects_are_found_by_class_and_region_and_told_one_by_one(asked: tuple[Node, Ask]) -> None:
    node, ask = asked
    ours = services_of(node)
    assert "no belief yet" in ask(FindObjects, "find_objects", FindObjects.Request(name="cup")).fault
    classes = np.array([[0.9, 0.1], [0.2, 0.8], [0.4, 0.6]])
    belief = replace(
        map_of(3),
        class_names=("chair", "cup"),
        class_probabilities=classes,
        hypothesis_class_probabilities=classes[None],
        existence=np.array([0.5, 1.0, 1.0]),
    )
    ours.update(update_of(belief))
    found = ask(FindObjects, "find_objects", FindObjects.Request(name="cup", least_probability=0.3))
    assert found.fault == "" and list(found.object_ids) == [1, 2]
    np.testing.assert_allclose(found.probabilities, [0.8, 0.6])
    np.testing.assert_array_equal(np.reshape(found.poses, (2, 7))[:, 0], [1.0, 2.0])
    assert len(found.covariances) == 2 * 36 and found.unknown == pytest.approx(0.95 * 0.2 * 0.4)
    here = ask(FindObjects, "find_objects", FindObjects.Request(name="cup", region=[1.5, -1.0, 2.5, 1.0]))
    assert here.object_ids[0] == 2 and here.probabilities[0] == pytest.approx(0.6, abs=1e-3)
    told = ask(GetObject, "get_object", GetObject.Request(object_id=0))
    assert told.fault == "" and told.name == "0" and told.existence == 0.5
    assert dict(zip(told.class_names, told.class_probabilities, strict=True)) == {"chair": 0.9, "cup": 0.1}


def test_objects_are_found_by_vectors_and_texts_as_the_command_line_finds_them(
    asked: tuple[Node, Ask], tmp_path: Path
) -> None:
    node, ask = asked
    record = read_record(run(tmp_path, looking(place_entries("ranges", 16))))
    ours = services_of(node)
    for belief in record.beliefs:
        ours.update(update_of(belief, measurements=record.measurements[belief.stamp_ns]))
    looks = appearances_of(record.beliefs, record.measurements, SemanticModelConfiguration())
    texts = {f"look {n}": look + 1.0 for n, look in enumerate([*LOOKS, -LOOKS[0]])}
    first = []
    by_text = {"text_names": list(texts), "text_vectors": np.concatenate(list(texts.values())).tolist()}
    for request, question in (
        ({"vector": LOOKS[1].tolist()}, Question(vector=LOOKS[1])),
        ({"vector": LOOKS[1].tolist(), "mapped": 0.1}, Question(vector=LOOKS[1], mapped=0.1)),
        ({"name": "look 0", **by_text}, Question(name="look 0", text_vectors=texts)),
    ):
        told = ask(FindObjects, "find_objects", FindObjects.Request(**request))
        expected = find_objects(record.beliefs[-1], question, looks)
        assert (told.fault, told.keyframe) == ("", record.beliefs[-1].keyframe)
        assert list(told.object_ids) == [own.object_id for own in expected.objects]
        np.testing.assert_allclose(told.probabilities, [own.probability for own in expected.objects])
        assert told.unknown == pytest.approx(expected.unknown)
        first.append(told.probabilities[0])
    assert first[0] > 0.9 and first[1] < first[0]
    ours.begin()
    assert "no belief yet" in ask(FindObjects, "find_objects", FindObjects.Request(vector=[1.0])).fault


def test_a_place_is_told_with_what_is_there_and_what_is_gone(asked: tuple[Node, Ask]) -> None:
    node, ask = asked
    ours = services_of(node)
    belief = replace(map_of(2), existence=np.array([0.25, 1.0]), missing=np.array([0.75, 0.0]))
    prior = MapPrior((ObjectPrior.planar(9, 0.0, 0.0, sigma_m=0.01, sigma_rad=0.1),))
    ours.update(update_of(belief, map_prior=prior))
    region = [-0.5, -0.5, 0.5, 0.5]
    told = ask(QueryPlace, "query_place", QueryPlace.Request(region=region, least_probability=0.1))
    assert told.fault == "" and list(told.object_ids) == [0, 9] and len(told.poses) == 14
    np.testing.assert_allclose([told.here, told.gone], [[0.25, 0.0], [0.75, 1.0]], atol=1e-6)


def test_the_map_is_written_and_a_file_that_is_there_stays(asked: tuple[Node, Ask], tmp_path: Path) -> None:
    node, ask = asked
    engine, belief = run_to_its_end(LOOSE)
    ours, place = MapService(node, lambda: engine.run), tmp_path / "room.map"
    assert "no belief yet" in ask(SaveMap, "save_map", SaveMap.Request(path=str(place))).fault
    ours.update(update_of(belief))
    told = ask(SaveMap, "save_map", SaveMap.Request(path=str(place)))
    known = read_map(place)
    assert (told.fault, told.keyframe, told.map_id, told.objects) == ("", belief.keyframe, known.map_id, 4)
    assert not known.has_cross_covariances and known.provenance.run_id == engine.run.run_id
    assert "give overwrite: true" in ask(SaveMap, "save_map", SaveMap.Request(path=str(place))).fault
    assert ask(SaveMap, "save_map", SaveMap.Request(path=str(place), overwrite=True)).fault == ""
    assert "path is empty" in ask(SaveMap, "save_map", SaveMap.Request()).fault
    assert "/dev/null" in ask(SaveMap, "save_map", SaveMap.Request(path="/dev/null/room.map")).fault
    assert [own.name for own in tmp_path.iterdir()] == ["room.map"]


@pytest.mark.parametrize(
    ("kind", "name", "request_", "fault"),
    [
        (FindObjects, "find_objects", FindObjects.Request(name="tv"), "is no class of the map"),
        (FindObjects, "find_objects", FindObjects.Request(name="cup", region=[1.0]), "region has 1 numbers"),
        (FindObjects, "find_objects", FindObjects.Request(vector=[1.0, 2.0]), "no detection of this run has a vector"),
        (FindObjects, "find_objects", FindObjects.Request(name="a", vector=[1.0]), "one after the other"),
        (FindObjects, "find_objects", FindObjects.Request(vector=[1.0], mapped=1.0), "between 0 and 1"),
        (
            FindObjects,
            "find_objects",
            FindObjects.Request(name="a", text_names=["a", "b"], text_vectors=[1.0] * 3),
            "3 numbers for 2 text_names",
        ),
        (FindObjects, "find_objects", FindObjects.Request(name="a", text_names=["a"]), "0 numbers for 1 text_names"),
        (
            FindObjects,
            "find_objects",
            FindObjects.Request(name="a", text_names=["a", "a"], text_vectors=[1.0] * 4),
            "given twice",
        ),
        (QueryPlace, "query_place", QueryPlace.Request(least_probability=2.0), "least probability"),
        (GetObject, "get_object", GetObject.Request(object_id=7), "object 7 is not on the map, which has 0, 1"),
    ],
)
def test_what_cannot_be_answered_is_one_line(
    asked: tuple[Node, Ask], kind: Any, name: str, request_: Any, fault: str
) -> None:
    node, ask = asked
    services_of(node).update(update_of(map_of(2)))
    assert fault in ask(kind, name, request_).fault
