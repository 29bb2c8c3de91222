"""``~/explain`` says what the command does of the recorded run, while the node goes on."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from semantic_slam_msgs.srv import Explain
from worlds.bags.bag_factory import of_topic, write_bag
from worlds.bags.places import place_entries
from worlds.belief_updates import update_of

from semantic_slam.answers.explain.explanation import explain
from semantic_slam.answers.explain.text import lines_of
from semantic_slam.configuration import Configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.pipeline.recorded_keyframes import recorded_keyframes
from semantic_slam.ros.services.explain_service import ExplainService

pytestmark = pytest.mark.ros

SETTINGS = Configuration.of(association="open", semantic_model={"kind": "detector"})


@pytest.fixture(scope="module")
def belief_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive past a chair and a cup."""
    out = tmp_path_factory.mktemp("explain")
    entries = place_entries("ranges", 6)
    for entry in of_topic(entries, topics.DETECTIONS):
        entry.message = to_message(replace(from_message(entry.message), labels=("chair", "cup")))
    run_bag(write_bag(out / "input", entries), out / "belief", SETTINGS)
    return out / "belief"


class Asker:
    """A node with the service, and a clock that ticks as long as its executor does not wait for anything."""

    def __init__(self) -> None:
        self.node: Node = rclpy.create_node("hypothesis_manager")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.ticks: list[float] = []
        self.node.create_timer(0.05, lambda: self.ticks.append(time.monotonic()))
        self.service = ExplainService(self.node)
        self.client = self.node.create_client(Explain, "~/explain")
        assert self.client.wait_for_service(timeout_sec=120.0)

    def ask(self, object_id: int) -> Any:
        future = self.client.call_async(Explain.Request(object_id=object_id))
        self.executor.spin_until_future_complete(future, timeout_sec=120.0)  # another process does the work
        return future.result()

    def tell(self, belief_bag: Path, count: int) -> None:
        record = read_record(belief_bag)
        kept = KeptRun(record.run)
        for keyframe in recorded_keyframes(belief_bag, SETTINGS, count):
            kept.add(keyframe)
            self.service.update(update_of(record.beliefs[keyframe.index], kept_run=kept))


@pytest.fixture
def asker() -> Iterator[Asker]:
    rclpy.init()
    asker = Asker()
    try:
        yield asker
    finally:
        asker.service.close()
        asker.executor.shutdown()
        asker.node.destroy_node()
        rclpy.shutdown()


@pytest.mark.long
def test_the_explain_service_answers_as_the_command_does_while_the_node_goes_on(asker: Asker, belief_bag: Path) -> None:
    asker.tell(belief_bag, 6)
    told = asker.ask(1)
    assert (told.fault, told.keyframe) == ("", 5)
    assert told.explanation.splitlines() == lines_of(explain(belief_bag, "1"))
    assert max(after - before for before, after in zip(asker.ticks, asker.ticks[1:], strict=False)) < 0.5


@pytest.mark.long
def test_what_cannot_be_explained_is_one_line_and_another_run_is_another_one(asker: Asker, belief_bag: Path) -> None:
    assert "there is no belief yet" in asker.ask(1).fault
    asker.tell(belief_bag, 2)
    assert "object 7 is not on the map, which has 1, 2; ask for one of these" in asker.ask(7).fault
    asker.service.begin()
    assert "there is no belief yet" in asker.ask(1).fault
    record = read_record(belief_bag)
    (first, _, third) = recorded_keyframes(belief_bag, SETTINGS, 3)
    kept = KeptRun(record.run)
    for keyframe in (first, replace(third, index=1)):
        kept.add(keyframe)
    asker.service.update(update_of(record.beliefs[1], kept_run=kept))
    fault = asker.ask(1).fault
    assert "keyframe 1: inferred again, the hypotheses are not those recorded" in fault and "\n" not in fault
