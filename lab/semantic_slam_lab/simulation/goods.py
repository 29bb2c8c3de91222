"""Goods: any number of instances of a few classes, each with proportions and pictures of its own.

An instance is named ``<class>_<number>``; everything about it follows from that name. Frame as in furniture.py.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.simulation.furniture import ObjectModel
from semantic_slam_lab.simulation.surface import Surface, disc, revolved
from semantic_slam_lab.simulation.textures import generator

SPREAD = 0.12
"""Standard deviation of the logarithm of an instance's lengths."""


@dataclass(frozen=True)
class RoundModel:
    """A solid of revolution with a picture wrapped around it and a lid."""

    name: str
    profile: tuple[tuple[float, float], ...]  # radii and heights above the middle, from the bottom up, metres
    wrap: str
    top: str

    @property
    def size(self) -> tuple[float, float, float]:
        """Size along x, y, z in metres."""
        widest = 2.0 * max(radius for radius, _ in self.profile)
        return widest, widest, self.profile[-1][1] - self.profile[0][1]

    def surfaces(self) -> tuple[Surface, ...]:
        """The wrap and the lid."""
        radius, height = self.profile[-1]
        return revolved("wrap", self.wrap, np.array(self.profile)), disc("top", self.top, radius, height)


Model = ObjectModel | RoundModel


def goods_model(name: str) -> Model:
    """The model of an instance such as ``drum_03``; raises KeyError when no class is called so."""
    class_name = goods_class(name)
    lengths = np.exp(SPREAD * generator(f"{name}/size").standard_normal(3))
    return CLASSES[class_name](name, lengths)


def goods_class(name: str) -> str:
    """The class of an instance; raises KeyError."""
    match = re.fullmatch(r"([a-z]+)_(\d+)", name)
    if match is None or match[1] not in CLASSES:
        raise KeyError(name)
    return match[1]


def goods_names(count: int) -> tuple[str, ...]:
    """The first ``count`` instances, class by class in turn."""
    classes = sorted(CLASSES)
    return tuple(f"{classes[at % len(classes)]}_{at // len(classes) + 1:02d}" for at in range(count))


def _box(depth: float, width: float, height: float) -> Callable[[str, Array], Model]:
    def build(name: str, lengths: Array) -> Model:
        size = (depth * lengths[0], width * lengths[1], height * lengths[2])
        return ObjectModel(name, size, *(f"{name}/{side}" for side in ("front", "left", "back", "right", "top")))

    return build


def _round(*profile: tuple[float, float]) -> Callable[[str, Array], Model]:
    def build(name: str, lengths: Array) -> Model:
        scaled = tuple((radius * lengths[0], height * lengths[2]) for radius, height in profile)
        return RoundModel(name, scaled, f"{name}/wrap", f"{name}/top")

    return build


CLASSES: dict[str, Callable[[str, Array], Model]] = {
    "barrel": _round((0.22, -0.36), (0.27, -0.2), (0.29, 0.0), (0.27, 0.2), (0.22, 0.36)),
    "bin": _round((0.22, -0.38), (0.3, 0.38)),
    "cooler": _box(0.45, 0.68, 0.46),
    "drum": _round((0.29, -0.38), (0.29, 0.38)),
    "engine": _box(0.66, 0.46, 0.56),
    "parcel": _box(0.56, 0.6, 0.48),
    "speaker": _box(0.42, 0.44, 0.84),
    "vendor": _box(0.48, 0.54, 0.86),
}
"""Class name -> model of an instance by its name and three factors of its lengths."""
