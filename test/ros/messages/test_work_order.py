"""A backend works in the order of the rounds, and nothing that it is sent otherwise changes what it answers."""

import errno
import os
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from worlds.same_beliefs import assert_same
from worlds.scenes.three_places import CLOSED, OPEN, drive

from semantic_slam.configuration import Configuration, from_dict
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.building import make_run_configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import (
    Candidates,
    Commit,
    Components,
    MissedKeyframes,
    RunConfiguration,
)
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode, from_message, to_message
from semantic_slam.messages.typestore import serialize
from semantic_slam.ros.node.health import Level, disk_status
from semantic_slam.ros.rounds.waiting import MOST_WAITING
from semantic_slam.ros.rounds.work_order import WorkOrder


class Wire:
    """A pool of backends behind bytes: what the nodes do, without DDS."""

    def __init__(self, number: int = 1, spoil: Callable[[bytes], list[bytes]] | None = None) -> None:
        self.backend_ids = tuple(range(number))
        self.orders = [WorkOrder(lambda n=n: Backend(n)) for n in self.backend_ids]  # type: ignore[misc]
        self.said: list[tuple[bytes, str]] = []
        self._spoil = spoil or (lambda data: [data])

    def start(self, run: RunConfiguration) -> None:
        self._run_id = run.run_id
        self._say(encode(run), to_message(run).__msgtype__)

    def begin(self, keyframe: Keyframe) -> None:
        pass

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        message = to_message(keyframe, run_id=self._run_id)
        return self._say(serialize(message), message.__msgtype__)

    def commit(self, commit: Commit) -> list[Components]:
        return self._say(encode(commit), to_message(commit).__msgtype__)

    def _say(self, data: bytes, type_name: str) -> list[Any]:
        self.said.append((data, type_name))
        answers = []
        for order in self.orders:
            taken = [answer for piece in self._spoil(data) for answer in order.take(piece, type_name)]
            answers += [decode(encode(answer), to_message(answer).__msgtype__) for answer in taken[-1:]]
        return answers

    @property
    def dropped(self) -> dict[str, int]:
        return dict(self.orders[0].dropped)


@pytest.fixture(scope="module")
def spoken() -> list[tuple[bytes, str]]:
    """Announcement, then keyframe and commit in turn, of a run of two keyframes."""
    wire = Wire()
    drive(CLOSED, wire, 2)
    assert len(wire.said) == 5
    return wire.said


def answers(order: WorkOrder, said: list[tuple[bytes, str]]) -> list[bytes]:
    return [encode(answer) for message in said for answer in order.take(*message)]


def changed(said: tuple[bytes, str], **fields: Any) -> tuple[bytes, str]:
    message = to_message(decode(*said), **({"run_id": "?"} if said[1].endswith("Keyframe") else {}))
    for name, value in fields.items():
        setattr(message, name, value)
    return serialize(message), said[1]


@pytest.mark.parametrize("configuration", [CLOSED, OPEN])
@pytest.mark.parametrize("number", [1, 2])
def test_over_the_wire_beliefs_are_those_of_this_process_and_nothing_is_dropped(
    configuration: Configuration, number: int
) -> None:
    wire = Wire(number)
    for ours, theirs in zip(drive(configuration, wire), drive(configuration, InProcessPool(number)), strict=True):
        assert_same(ours, theirs)
    assert not wire.dropped


def test_a_full_disk_changes_no_belief_and_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    short = from_dict(
        {"semantic_model": {"kind": "none"}, "history": {"horizon_keyframes": 20}, "weights": {"max_history": 10}}
    )
    expected, wire = drive(short, InProcessPool(1), 26), Wire()
    assert disk_status(wire.orders[0].disk_fault).level == Level.OK

    def full(*_: Any) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    for ours, theirs in zip(drive(short, wire, 26), expected, strict=True):
        assert_same(ours, theirs)
    said = disk_status(wire.orders[0].disk_fault)
    assert said.level == Level.WARN and "No space left on device" in said.message and "TMPDIR" in said.message


def orders_of_topics() -> list[tuple[int, ...]]:
    """Announcement, two keyframes, two commits: every order that keeps the order within each topic."""
    orders = [o for o in permutations(range(5)) if o.index(1) < o.index(3) and o.index(2) < o.index(4)]
    assert len(orders) == 30  # 5! / (2! 2!)
    return orders


def test_rounds_do_not_depend_on_the_order_between_topics(spoken: list[tuple[bytes, str]]) -> None:
    """A manager asks for the second keyframe once the commit of the first one has been answered."""
    expected = answers(WorkOrder(lambda: Backend(0)), spoken)
    orders = [o for o in orders_of_topics() if max(o.index(0), o.index(1), o.index(2)) < o.index(3)]
    assert len(orders) == 18 and len(expected) == 4
    for order in orders:
        assert answers(WorkOrder(lambda: Backend(0)), [spoken[n] for n in order]) == expected


def test_whoever_asks_for_a_keyframe_waits_for_nothing_before_it(spoken: list[tuple[bytes, str]]) -> None:
    """The commit in between is that of others, or comes too late: no hypothesis is held, and none is made up."""
    expected = answers(WorkOrder(lambda: Backend(0)), spoken)
    for order in orders_of_topics():
        if order.index(0) < order.index(3) < order.index(2):
            told = answers(WorkOrder(lambda: Backend(0)), [spoken[n] for n in order])
            last = decode(told[-1], topics.TYPES[topics.COMPONENTS])
            assert told[0] == expected[0] and not len(last.ids) and not len(last.lost_ids)


def test_a_backend_that_was_started_again_learns_the_keyframes_and_is_given_hypotheses(
    spoken: list[tuple[bytes, str]],
) -> None:
    """It is sent all that was said; the newest keyframe alone is answered, and lineages are rebuilt to the bit."""
    expected = answers(WorkOrder(lambda: Backend(0)), spoken)
    order = WorkOrder(lambda: Backend(0))
    told = [answer for said in spoken[:3] for answer in order.take(*said, more=True)] + order.take(*spoken[3])
    assert [len(answer.ids) for answer in told] == [0]
    assert answers(order, [spoken[2], spoken[3], spoken[4]]) == expected[1:]
    assert not order.dropped


def test_keyframes_that_others_have_missed_change_nothing(spoken: list[tuple[bytes, str]]) -> None:
    expected = answers(WorkOrder(lambda: Backend(0)), spoken)
    order = WorkOrder(lambda: Backend(0))
    told = [changed(said, again=True, run_id=decode(*spoken[0]).run_id) for said in (spoken[1], spoken[3])]
    assert answers(order, [*spoken[:3], told[0], told[0], *spoken[3:], *told, *told]) == expected
    assert not order.dropped and order.repeated[topics.KEYFRAMES] == 6 == order.repeated.total()


def test_a_manager_that_lost_a_round_is_given_it_again(spoken: list[tuple[bytes, str]]) -> None:
    """It asks for a keyframe that the backend has committed, and having no answer asks again."""
    order = WorkOrder(lambda: Backend(0))
    first = answers(order, spoken)
    assert answers(order, [spoken[3]]) == []
    (empty,) = answers(order, [spoken[3]])
    assert not len(decode(empty, topics.TYPES[topics.CANDIDATES]).expanded_parent_ids)
    assert answers(order, [spoken[2], spoken[3], spoken[4]]) == first[1:]


def test_newest_keyframe_is_answered_again_and_a_second_run_begins_anew(spoken: list[tuple[bytes, str]]) -> None:
    order = WorkOrder(lambda: Backend(0))
    first = answers(order, spoken[:4])
    assert answers(order, spoken[3:4]) == first[-1:]
    assert answers(order, [spoken[1], spoken[1]]) == first[:1]  # whoever asks twice has begun again
    assert answers(order, spoken[2:]) == answers(WorkOrder(lambda: Backend(0)), spoken)[1:]


def test_another_recording_in_the_same_configuration_begins_anew_once_it_is_announced(
    spoken: list[tuple[bytes, str]],
) -> None:
    keyframe = decode(*spoken[1])
    later = to_message(replace(keyframe, stamp_ns=keyframe.stamp_ns + 1), run_id=decode(*spoken[0]).run_id)
    order = WorkOrder(lambda: Backend(0))
    answers(order, spoken)
    assert answers(order, [(serialize(later), spoken[1][1])]) == [] and order.dropped.total() == 1
    (told,) = answers(order, [spoken[0], (serialize(later), spoken[1][1])])
    assert len(decode(told, topics.TYPES[topics.CANDIDATES]).ids)


def test_a_manager_that_went_back_to_an_earlier_keyframe_has_another_history_from_there_on() -> None:
    """Its journal was damaged: a backend that lived on asks for the keyframes, as one that was started again."""
    wire = Wire()
    drive(CLOSED, wire, 4)
    said, run_id = wire.said, decode(*wire.said[0]).run_id
    keyframes = [decode(*one) for one in said[1::2]]
    anew = replace(keyframes[2], stamp_ns=keyframes[3].stamp_ns + 1)
    type_name = said[1][1]
    asked = serialize(to_message(anew, run_id=run_id)), type_name
    told = [(encode(own, run_id=run_id, again=True), type_name) for own in (*keyframes[:2], anew)]
    order = wire.orders[0]
    missing = encode(MissedKeyframes(run_id=run_id, backend_id=0, keyframe=0))
    assert answers(order, [said[0], asked, asked]) == [missing, missing]
    started_again = WorkOrder(lambda: Backend(0))
    found, expected = answers(order, [*told, asked]), answers(started_again, [said[0], *told, asked])
    assert found == expected and decode(found[-1], topics.TYPES[topics.CANDIDATES]).keyframe == 2


def test_a_repeated_announcement_alone_changes_nothing(spoken: list[tuple[bytes, str]]) -> None:
    expected = answers(WorkOrder(lambda: Backend(0)), spoken)
    order = WorkOrder(lambda: Backend(0))
    assert answers(order, [*spoken[:3], spoken[0], *spoken[3:]]) == expected


def of_another_run(said: tuple[bytes, str]) -> tuple[bytes, str]:
    run = decode(*said)
    pose = run.initial_pose + np.array([1.0, 0, 0, 0, 0, 0, 0])
    prior = MapPrior(tuple(ObjectPrior.planar(9, 1.0, 1.0, sigma_m=0.1, sigma_rad=0.1) for _ in range(1)))
    other = make_run_configuration(CLOSED, prior, pose, run.initial_covariance, stamp_ns=1)
    assert other.run_id != run.run_id
    return encode(other), said[1]


@pytest.mark.parametrize("often", [1, 3])
def test_the_announcement_of_another_run_silences_nobody(spoken: list[tuple[bytes, str]], often: int) -> None:
    expected = answers(WorkOrder(lambda: Backend(0)), spoken)
    order = WorkOrder(lambda: Backend(0))
    others = [of_another_run(spoken[0])] * often
    assert answers(order, [*spoken[:3], *others, *spoken[3:]]) == expected


SPOILED: dict[str, Callable[[list[tuple[bytes, str]]], tuple[bytes, str]]] = {
    "garbage": lambda said: (b"\x00\x01\x00\x00" + b"\xff" * 40, said[3][1]),
    "nothing": lambda said: (b"", said[2][1]),
    "cut": lambda said: (said[3][0][:-9], said[3][1]),
    "arrays of different lengths": lambda said: changed(said[2], log_weights=np.zeros(0)),
    "emptied commit": lambda said: (encode(_emptied(decode(*said[2]))), said[2][1]),
    "weights NaN": lambda said: changed(said[2], log_weights=decode(*said[2]).log_weights * np.nan),
    "ids of nobody": lambda said: changed(said[2], ids=decode(*said[2]).ids + np.uint64(1)),
    "no json": lambda said: changed(said[0], configuration="{", run_id="x"),
    "another configuration under this id": lambda said: changed(said[0], configuration="{}"),
    "an earlier keyframe": lambda said: said[1],
}
REPEATS = {"another configuration under this id", "an earlier keyframe"}


def _emptied(commit: Commit) -> Commit:
    return replace(
        commit,
        ids=commit.ids[:0],
        parent_ids=commit.parent_ids[:0],
        steps=(),
        log_weights=commit.log_weights[:0],
        owners=commit.owners[:0],
        lineages=(),
    )


@pytest.mark.parametrize("what", SPOILED)
@pytest.mark.parametrize("place", [3, 4])
def test_what_cannot_be_used_is_counted_and_changes_no_answer(
    spoken: list[tuple[bytes, str]], what: str, place: int
) -> None:
    expected = answers(WorkOrder(lambda: Backend(0)), spoken)
    order = WorkOrder(lambda: Backend(0))
    said = deepcopy(spoken)
    said.insert(place, SPOILED[what](spoken))
    assert answers(order, said) == expected or what == "another configuration under this id"
    assert order.dropped.total() == (0 if what in REPEATS else 1)


def test_a_keyframe_that_is_no_motion_is_refused(spoken: list[tuple[bytes, str]]) -> None:
    keyframe = decode(*spoken[1])
    order = WorkOrder(lambda: Backend(0))
    answers(order, spoken[:1])
    nowhere = replace(keyframe.measurements, bearings_rad=keyframe.measurements.bearings_rad * np.nan)
    for name, value in (
        ("odometry", np.full(7, np.nan)),
        ("odometry", np.array([1e300, 0, 0, 0, 0, 0, 1])),
        ("odometry_covariance", -np.eye(6)),
        ("measurements", nowhere),
    ):
        message = to_message(replace(keyframe, **{name: value}), run_id=decode(*spoken[0]).run_id)
        assert order.take(serialize(message), spoken[1][1]) == []
    assert order.dropped.total() == 4


def test_keyframes_of_runs_that_nobody_announced_are_bounded(spoken: list[tuple[bytes, str]]) -> None:
    order = WorkOrder(lambda: Backend(0))
    keyframe = decode(*spoken[1])
    for index in range(MOST_WAITING + 7):
        order.keyframe("nobody's", replace(keyframe, index=index))
    assert order.dropped.total() == 7
    assert from_message(to_message(keyframe, run_id="x")).index == 0


def test_what_is_out_of_turn_or_of_a_run_that_nobody_announced_is_counted_and_changes_no_answer(
    spoken: list[tuple[bytes, str]],
) -> None:
    """A topic leaves out nothing, and nothing of an announced run follows on it after what is of another one."""
    expected = answers(WorkOrder(lambda: Backend(0)), spoken)
    keyframe, commit = decode(*spoken[3]), decode(*spoken[4])
    far = serialize(to_message(replace(keyframe, index=1000), run_id=commit.run_id)), spoken[3][1]
    others = serialize(to_message(keyframe, run_id="nobody's")), spoken[3][1]
    order = WorkOrder(lambda: Backend(0))
    nobodys = changed(spoken[4], run_id="nobody's")
    said = [*spoken[:3], far, others, spoken[3], changed(spoken[4], keyframe=900), nobodys, spoken[4]]
    asked = [encode(MissedKeyframes(run_id=commit.run_id, backend_id=0, keyframe=known)) for known in (1, 2)]
    assert answers(order, said) == [*expected[:2], asked[0], expected[2], asked[1], expected[3]]
    assert order.dropped == {
        f"{topics.KEYFRAMES}: out of turn": 1,
        f"{topics.KEYFRAMES}: of a run that is not announced": 1,
        f"{topics.COMMITS}: out of turn": 1,
        f"{topics.COMMITS}: of a run that is not announced": 1,
    }


def test_a_keyframe_that_overtakes_the_announcement_keeps_nobody_from_asking_for_those_before(
    spoken: list[tuple[bytes, str]],
) -> None:
    run, keyframe = decode(*spoken[0]), decode(*spoken[3])
    later = [(encode(replace(keyframe, index=n), run_id=run.run_id), spoken[3][1]) for n in (5, 6)]
    asked = encode(MissedKeyframes(run_id=run.run_id, backend_id=0, keyframe=0))
    assert answers(WorkOrder(lambda: Backend(0)), [later[0], spoken[0], later[1]]) == [asked]


def test_what_came_before_is_counted_apart(spoken: list[tuple[bytes, str]]) -> None:
    order = WorkOrder(lambda: Backend(0))
    answers(order, [*spoken, spoken[0], spoken[1], spoken[4]])
    assert order.repeated == {topics.RUN_CONFIGURATION: 1, topics.KEYFRAMES: 1, topics.COMMITS: 1}
    assert not order.dropped
