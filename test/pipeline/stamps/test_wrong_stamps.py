"""A stamp far ahead costs its message: a topic believes a leap only when the two messages after it confirm it."""

import random
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import load_configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.messages.standard import NANOSECONDS, header_stamp_ns, time_message
from semantic_slam.messages.typestore import serialize
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.pipeline.stamps.topic_clock import TopicClock
from semantic_slam.report.document import analyse, report_document

ROOT = Path(__file__).parents[3]
SHIPPED, DEFAULT = ROOT / "bags" / "aliased_room", ROOT / "config" / "default.yaml"
NUM_FRAMES, LAST_NS = 14, 1011 * NANOSECONDS
"""Of the shipped bag, until so late."""
FAR_NS, NEAR_NS = 1_000_000 * NANOSECONDS, 5 * NANOSECONDS
LEAPS = "stamp leaps ahead of those around it"


def believed(*stamps: int) -> tuple[list[int], dict[str, int]]:
    """The stamps that a clock gives out until its end, and what it counts."""
    dropped: Counter[str] = Counter()
    clock: TopicClock[None] = TopicClock("odom", dropped)
    taken: list[int] = []
    for new in stamps:
        now = [stamp for stamp, _ in clock.take(new, None)]
        if clock.withdrawn_from_ns is not None:
            taken = [stamp for stamp in taken if stamp < clock.withdrawn_from_ns]
        taken += now
    return [*taken, *(stamp for stamp, _ in clock.release())], dict(dropped)


def test_a_lone_stamp_ahead_is_dropped_and_counted() -> None:
    assert believed(0, 10, 20, 9000, 40, 50) == ([0, 10, 20, 40, 50], {f"odom: {LEAPS}": 1})


@pytest.mark.parametrize("second", [9010, 900_000])
def test_two_wrong_stamps_in_a_row_cost_those_two(second: int) -> None:
    assert believed(0, 10, 20, 9000, second, 50, 60) == ([0, 10, 20, 50, 60], {f"odom: {LEAPS}": 2})


def test_two_wrong_stamps_at_the_very_beginning_cost_those_two() -> None:
    assert believed(9000, 9010, 20, 30, 40, 50) == ([20, 30, 40, 50], {f"odom: {LEAPS}": 2})
    assert believed(10, 500, 30, 40, 50) == ([10, 30, 40, 50], {f"odom: {LEAPS}": 1})


def test_a_clock_that_is_set_back_is_named_and_one_straggler_is_not() -> None:
    assert believed(1000, 1010, 1020, 1030, 0, 10, 20, 30) == (
        [1000, 1010, 1020, 1030],
        {"odom: its clock was set back; what follows is another session, to be run by itself": 4},
    )
    assert believed(1000, 1010, 1020, 7, 1030, 8, 1040)[1] == {"odom: time goes backwards": 2}


def test_the_first_stamp_is_withdrawn_when_the_two_after_it_agree_on_an_earlier_time() -> None:
    assert believed(9000, 10, 20, 30) == ([10, 20, 30], {f"odom: {LEAPS}": 1})
    assert believed(100, 10, 110, 120) == ([100, 110, 120], {"odom: time goes backwards": 1})


def test_a_gap_is_a_gap_and_costs_nothing() -> None:
    assert believed(0, 10, 20, 9000, 9010, 9020) == ([0, 10, 20, 9000, 9010, 9020], {})


def test_a_stamp_after_a_gap_at_the_very_end_is_believed() -> None:
    assert believed(0, 10, 20, 9000) == ([0, 10, 20, 9000], {})


def test_a_second_stamp_ahead_has_its_own_judgement() -> None:
    assert believed(0, 10, 20, 9000, 800, 50, 60) == ([0, 10, 20, 50, 60], {f"odom: {LEAPS}": 2})


def test_a_repeated_stamp_ahead_is_no_second_witness() -> None:
    stamps, dropped = believed(0, 10, 20, 9000, 9000, 50)
    assert stamps == [0, 10, 20, 50]
    assert dropped == {f"odom: {LEAPS}": 1, "odom: stamp repeats": 1}


@pytest.mark.parametrize("seed", range(5))
def test_growing_stamps_are_all_believed_however_irregular(seed: int) -> None:
    chance = random.Random(seed)
    stamps = [0]
    for _ in range(200):
        stamps.append(stamps[-1] + chance.choice([1, 5, 100, 10**4, 10**9, 10**12]))
    assert believed(*stamps) == (stamps, {})


def spoiled(bag: Path, wrong: dict[tuple[str, int], int]) -> Path:
    """The beginning of the shipped bag; the header stamps of some messages, (topic, place), lie ahead."""
    seen: Counter[str] = Counter()
    with BagReader(SHIPPED) as reader, BagWriter(bag) as writer:
        for message in reader.messages():
            if message.stamp_ns > LAST_NS:
                break
            ahead_ns = wrong.get((message.topic, seen[message.topic]), 0)
            seen[message.topic] += 1
            cdr = _moved(reader, message, ahead_ns) if ahead_ns else message.cdr
            writer.write_raw(message.topic, message.type_name, cdr, message.stamp_ns)
    (bag / "objects.json").write_bytes((SHIPPED / "objects.json").read_bytes())
    return bag


def _moved(reader: BagReader, message: Any, ahead_ns: int) -> bytes:
    content = reader.decode(message.cdr, message.type_name)
    content.header.stamp = time_message(header_stamp_ns(content) + ahead_ns)
    return serialize(content)


def report_of(bag: Path, out: Path) -> dict[str, Any]:
    configuration = load_configuration(DEFAULT)
    fast = replace(configuration, perception=replace(configuration.perception, num_passes=2))
    belief_bag = run_bag(bag, out / "belief", fast).belief_bag
    return report_document(analyse(read_record(belief_bag), belief_bag, ""))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("undisturbed")
    return report_of(spoiled(folder / "bag", {}), folder / "out")


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "lost", "dropped"),
    [
        ({("/odom", 0): FAR_NS}, 0, {f"odom: {LEAPS}": 1}),
        ({("/detections", 0): FAR_NS}, 1, {f"detections: {LEAPS}": 1}),
        (
            {("/detections", 8): NEAR_NS, ("/image/compressed", 11): FAR_NS},
            2,
            {f"detections: {LEAPS}": 1, f"image: {LEAPS}": 1, "detections: no image of their stamp": 1},
        ),
        (
            {("/odom", 11): FAR_NS, ("/odom", 20): NEAR_NS, ("/detections", 11): FAR_NS},
            1,
            {f"odom: {LEAPS}": 2, f"detections: {LEAPS}": 1},
        ),
    ],
)
def test_each_wrong_stamp_on_the_shipped_bag_costs_one_message(
    tmp_path: Path, undisturbed: dict[str, Any], wrong: Any, lost: int, dropped: dict[str, int]
) -> None:
    report = report_of(spoiled(tmp_path / "bag", wrong), tmp_path / "out")
    assert report["dropped"] == dropped
    assert len(report["keyframes"]) == len(undisturbed["keyframes"]) - lost == NUM_FRAMES - lost
    now, before = report["metrics"], undisturbed["metrics"]
    assert now["ate_m"] == pytest.approx(before["ate_m"], abs=0.05)
    assert now["nees_mean"] == pytest.approx(before["nees_mean"], abs=1.0)
    assert now["dead_reckoning_true_start_ate_m"] == pytest.approx(before["dead_reckoning_true_start_ate_m"], abs=0.1)
    assert now["association_f1"] == 1.0
