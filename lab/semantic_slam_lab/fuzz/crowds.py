"""Keyframes with far more detections than usual: valid input whose work has to be bounded."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.random import Generator

from semantic_slam.configuration import Configuration, from_dict, load_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import SECOND_NS, Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.shipped import CONFIGURATIONS
from semantic_slam_lab.fuzz.harness import Case

LOST = {"semantic_model": {"kind": "none"}, "initial_pose": {"mean": [0.0, 0.0, 0.0], "sigma": [10.0, 10.0, 3.0]}}
OPEN = ("open_world", "detector", "uncalibrated")
MOST = 12
LABELS = ("chair", "cup", "tv")
STEP_M, SIGMA_M, KEYFRAMES = 0.1, 0.05, 2
REGION = (np.array([1.0, -0.9]), np.array([4.5, 0.9]))
"""Before the robot [m]."""


def crowds(folder: Path) -> Case:
    """Up to a dozen things side by side, without a map or on one where the robot is lost, or as many false alarms."""
    shipped = (load_configuration(CONFIGURATIONS / f"{name}.yaml") for name in OPEN)
    configurations = [from_dict(LOST), *map(_by_places_and_labels, shipped)]

    def case(chance: Generator) -> None:
        configuration = configurations[chance.integers(len(configurations))]
        things = chance.uniform(*REGION, (int(chance.integers(1, MOST + 1)), 2))
        is_lost = configuration is configurations[0]
        engine = Engine(configuration, _map_of(things[:8]) if is_lost else None)
        stand = is_lost or bool(chance.integers(2))
        for k in range(KEYFRAMES):
            there = things if stand else chance.uniform(*REGION, things.shape)
            seen = there - [STEP_M * (k + 1), 0.0] + SIGMA_M * chance.normal(size=things.shape)
            engine.process(
                Keyframe.planar(k, detections=_detected(seen), motion=(STEP_M, 0.0, 0.0), stamp_ns=SECOND_NS * (k + 1))
            )

    return case


def _by_places_and_labels(configuration: Configuration) -> Configuration:
    """The configuration without class models that need the scores of their own classifier."""
    settings = configuration.semantic_model
    kind = "detector" if settings.kind == "detector" else "none"
    return replace(configuration, semantic_model=replace(settings, kind=kind))


def _detected(places: np.ndarray) -> list[Detection]:
    return [Detection.at(x, y, label=LABELS[n % len(LABELS)]) for n, (x, y) in enumerate(places.tolist())]


def _map_of(places: np.ndarray) -> MapPrior:
    poses = enumerate(places.tolist())
    return MapPrior(tuple(ObjectPrior.planar(n, x, y, sigma_m=0.1, sigma_rad=0.1) for n, (x, y) in poses))
