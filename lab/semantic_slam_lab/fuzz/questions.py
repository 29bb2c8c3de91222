"""Requests that no service of the nodes should get: odd names, numbers and paths, transitions that there are not."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lifecycle_msgs.srv import ChangeState
from numpy.random import Generator
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from semantic_slam_msgs.srv import Explain, FindLookalike, FindObjects, GetObject, LoadMap, QueryPlace, SaveMap

MANAGER = "hypothesis_manager"
NODES = (MANAGER, "backend_0", "classifier", "bag_recorder", "bag_player")
NUMBERS = (float("nan"), float("inf"), -float("inf"), -1.0, 1e308, -1e308)
NO_OBJECT = 4_000_000_000
NO_TRANSITION = 77
LONG = 10_000
TO_ANY_NODE = 0.25
FOLDERS = ("/", "/dev", ".", "")
DEVICES = ("/dev/zero", "/dev/urandom", "/dev/null", "/proc/self/mem")


@dataclass(frozen=True)
class Question:
    """A request, whom it is sent to, and whether the answer says no."""

    node: str
    service: str
    kind: Any
    request: Any
    is_refused: Callable[[Any], bool]


def question(folder: Path, chance: Generator) -> Question:
    """One that is to be refused; ``folder`` is for files that it names."""
    if chance.random() < TO_ANY_NODE:
        return _to_any_node(chance)
    service, kind, request = MAKERS[chance.integers(len(MAKERS))]
    return Question(MANAGER, service, kind, request(folder, chance), lambda answer: bool(answer.fault))


def _to_any_node(chance: Generator) -> Question:
    node = NODES[chance.integers(len(NODES))]
    if chance.random() < 0.5:
        change = ChangeState.Request()
        change.transition.id, change.transition.label = NO_TRANSITION, ("", "fly")[chance.integers(2)]
        return Question(node, "change_state", ChangeState, change, lambda answer: not answer.success)
    value = ParameterValue(type=int(chance.integers(10)), double_value=float("nan"), string_value=_name(chance))
    name = ("lossless", "autostart", "no_such_parameter")[chance.integers(3)]
    setting = SetParametersAtomically.Request(parameters=[Parameter(name=name, value=value)])
    return Question(
        node, "set_parameters_atomically", SetParametersAtomically, setting, lambda answer: not answer.result.successful
    )


def _name(chance: Generator) -> str:
    return ("", "no such thing", "x" * LONG, "\u202e\n\t", "../..", "\ud7ff")[chance.integers(6)]


def _region(chance: Generator) -> list[float]:
    """Three numbers, or ten thousand, or four of which one is none."""
    if chance.random() < 0.5:
        return [0.0] * (3, LONG)[chance.integers(2)]
    found = [-1.0, -1.0, 1.0, 1.0]
    found[chance.integers(4)] = float("nan")
    return found


def _find(_: Path, chance: Generator) -> Any:
    return FindObjects.Request(
        name=_name(chance),
        region=_region(chance),
        least_probability=_number(chance),
        vector=[_number(chance) for _ in range(chance.integers(3))],
        text_names=[_name(chance) for _ in range(chance.integers(3))],
        text_vectors=[_number(chance) for _ in range(chance.integers(3))],
        mapped=_number(chance),
    )


def _query(_: Path, chance: Generator) -> Any:
    return QueryPlace.Request(region=_region(chance), least_probability=_number(chance))


def _number(chance: Generator) -> float:
    return NUMBERS[chance.integers(len(NUMBERS))]


def _look(_: Path, chance: Generator) -> Any:
    picture = chance.bytes(int(chance.integers(LONG)))
    return FindLookalike.Request(image=picture, box=[_number(chance) for _ in range(chance.integers(1, 6))])


def _save(folder: Path, chance: Generator) -> Any:
    """Where nothing may be written: folders, a pipe, below what is a file, names that no disk takes."""
    there = folder / "there.map"
    there.touch()
    paths = (*FOLDERS, _pipe(folder), str(there / "a.map"), str(folder / ("x" * LONG)))
    return SaveMap.Request(path=paths[chance.integers(len(paths))], overwrite=bool(chance.integers(2)))


def _load(folder: Path, chance: Generator) -> Any:
    """What is no map."""
    torn = folder / "torn.map"
    torn.write_bytes(chance.bytes(int(chance.integers(LONG))))
    paths = (
        *FOLDERS,
        *DEVICES,
        _pipe(folder),
        str(torn),
        str(folder / "none.map"),
        str(folder / ("x" * LONG)),
        _name(chance),
    )
    return LoadMap.Request(path=paths[chance.integers(len(paths))])


def _pipe(folder: Path) -> str:
    """A pipe that nobody writes to, and whose reader would wait for ever."""
    place = folder / "pipe.map"
    if not place.exists():
        os.mkfifo(place)
    return str(place)


MAKERS: tuple[tuple[str, Any, Callable[[Path, Generator], Any]], ...] = (
    ("find_objects", FindObjects, _find),
    ("query_place", QueryPlace, _query),
    ("get_object", GetObject, lambda _, chance: GetObject.Request(object_id=NO_OBJECT)),
    ("explain", Explain, lambda _, chance: Explain.Request(object_id=NO_OBJECT)),
    ("find_lookalike", FindLookalike, _look),
    ("save_map", SaveMap, _save),
    ("load_map", LoadMap, _load),
)
