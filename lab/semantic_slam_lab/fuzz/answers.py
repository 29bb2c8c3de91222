"""Questions to a belief that nobody should ask: names, vectors, regions and probabilities that are none."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.query_place import query_place
from semantic_slam.answers.question import Question
from semantic_slam.configuration import from_dict
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam_lab.fuzz import small_drive
from semantic_slam_lab.fuzz.harness import Case
from semantic_slam_lab.fuzz.mutation import EXTREME_NUMBERS

NAMES = ("crate", "chest", "", "teapot", "\x00", "x" * 10_000, "\u202e")
CLASSES = ("chest", "crate")
ODD = (*EXTREME_NUMBERS, float("nan"), float("inf"), -float("inf"))


def answers(folder: Path) -> Case:
    """Whatever is asked, the answer is one, or an error of ours."""
    belief, prior = believed(), small_drive.map_prior()

    def case(chance: Generator) -> None:
        region = None if chance.random() < 0.2 else tuple(_number(chance) for _ in range(4))
        least = _number(chance)
        if chance.random() < 0.5:
            query_place(belief, region, least, prior if chance.random() < 0.5 else None)  # type: ignore[arg-type]
            return
        asked: dict[str, Any] = {"region": region, "least_probability": least}
        if chance.random() < 0.7:
            asked["name"] = NAMES[chance.integers(len(NAMES))]
        if chance.random() < 0.3:
            asked["vector"] = np.array([_number(chance) for _ in range(chance.integers(4))])
        find_objects(belief, Question(**asked))

    return case


def believed() -> HybridBelief:
    """A belief in two objects whose classes are not sure."""
    engine = Engine(from_dict(small_drive.PLAIN), small_drive.map_prior())
    seen = [Detection.at(float(x), float(y)) for x, y in small_drive.OBJECTS]
    belief = engine.process(Keyframe.planar(0, detections=seen))
    rows = np.array([[0.3, 0.7], [0.9, 0.1]])
    return replace(
        belief,
        class_names=CLASSES,
        class_probabilities=rows,
        hypothesis_class_probabilities=np.tile(rows, (len(belief.hypothesis_ids), 1, 1)),
    )


def _number(chance: Generator) -> float:
    """Odd, or a place in the room, or a probability."""
    what = chance.random()
    if what < 0.4:
        return float(ODD[chance.integers(len(ODD))])
    return float(chance.uniform(-5.0, 5.0) if what < 0.7 else chance.random())
