"""Instances of the dataclasses that travel, every field with a value of its own, from annotations and layouts alone."""

from collections.abc import Iterator
from dataclasses import Field, fields, is_dataclass
from itertools import count
from typing import Any, get_type_hints

import numpy as np

from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.messages.codec import CODECS
from semantic_slam.messages.layout import Layout, element_types
from semantic_slam.messages.measurements import FIELD_NAMES

SIZES = {letter: 2 + row for row, letter in enumerate("BCDEFHKLMNOPSTXR")}
"""Rows of each dimension: all different, so that no array passes for one of other dimensions."""
STANDARD = {"pose": (7,), "covariance": (6, 6), "odometry": (7,), "odometry_covariance": (6, 6)}
STANDARD |= {"initial_pose": (7,), "initial_covariance": (6, 6)}
"""Arrays that travel in messages of the standard packages."""
MESSAGE_NAMES = {ours: name for name, ours in FIELD_NAMES.items()} | {"object_ids": "object_id"}
PARTS_OF_LINEAGES = {"steps": SIZES["S"], "lineages": SIZES["S"]}


def distinctive(kind: type, layout: Layout, element: dict[str, str], numbers: Iterator[int]) -> Any:
    """An instance whose every field has a value of its own."""
    hints = get_type_hints(kind)
    return kind(**{item.name: value_of(item, hints[item.name], layout, element, numbers) for item in fields(kind)})


def value_of(item: "Field[Any]", hint: Any, layout: Layout, element: dict[str, str], numbers: Iterator[int]) -> Any:
    if hint in (int, float, str):
        return hint(next(numbers))
    if hint is bool:
        return item.default is not True
    if is_dataclass(hint):
        codec = CODECS.get(hint)
        own = (codec.layout, element_types(codec.type_name)) if codec else (layout, element)
        return distinctive(hint, *own, numbers)
    if item.name in PARTS_OF_LINEAGES:
        return tuple(lineage_part(item.name, numbers) for _ in range(SIZES["S"]))
    if item.name == "changes":
        return tuple(changes(numbers) for _ in range(SIZES["K"]))
    name = item.name if item.name in {*layout, *STANDARD} else MESSAGE_NAMES[item.name]
    shape = [size_of(key) for key in layout.get(name, STANDARD.get(name, ()))]
    if element.get(name) == "string":
        return tuple(f"{name} {next(numbers)}" for _ in range(shape[0]))
    values = np.reshape([next(numbers) for _ in range(np.prod(shape))], shape)
    return values % 2 == 0 if element.get(name) == "bool" else values.astype(element.get(name, "float64"))


def size_of(key: str | int) -> int:
    if isinstance(key, int):
        return key
    return SIZES[key.removesuffix("+1")] + key.endswith("+1")


def lineage_part(name: str, numbers: Iterator[int]) -> Any:
    two = (next(numbers), next(numbers)), (next(numbers), next(numbers))
    step = LineageStep(*two, next(numbers), changes(numbers))
    return step if name == "steps" else (step, step)


def changes(numbers: Iterator[int]) -> Any:
    return ((next(numbers), next(numbers), next(numbers), next(numbers)),)


def of(kind: type) -> Any:
    codec = CODECS[kind]
    element = element_types(codec.type_name) if codec.layout else {}
    return distinctive(kind, codec.layout, element, count(1))
