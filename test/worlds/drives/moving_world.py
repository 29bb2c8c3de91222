"""A robot on an arc among ten objects that stand still, and two that cross its way: truth and detections are known."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe

STANDING = np.array(
    [[3, 2], [5, -2], [7, 3], [8, -1], [6, 6], [3, 8], [9, 5], [1, 4], [11, 2], [10, 8]], dtype=np.float64
)
STARTS, VELOCITIES = np.array([[2.0, -4.0], [9.0, 3.0]]), np.array([[0.15, 0.6], [-0.5, 0.25]])
STEP, STEP_SIGMAS = np.array([0.3, 0.0, 0.04]), np.array([0.02, 0.02, 0.01])
SIGMA_RANGE, SIGMA_BEARING = 0.05, 0.02
MAX_RANGE, HALF_ANGLE = 8.0, 1.4
DETECTION_PROBABILITY, CLUTTER = 0.9, 0.1


@dataclass(frozen=True)
class MovingWorld:
    """K keyframes, a second apart."""

    keyframes: list[Keyframe]
    truth: np.ndarray  # (K, 3)
    names: list[tuple[int, ...]]  # of every detection: an object that stands, from 10 on one that moves, -1 clutter


def make_world(num_keyframes: int = 40, *, seed: int = 0, movers: bool = True) -> MovingWorld:
    """What is detected of the objects that stand does not depend on whether there are ``movers``."""
    keyframes, truth, names = [], [], []
    x = np.zeros(3)
    for k in range(num_keyframes):
        random = np.random.default_rng([seed, k])
        x = se2.compose(se2.compose(x, STEP), se2.exp(random.normal(size=3) * STEP_SIGMAS))
        places = np.concatenate([STANDING, STARTS + (k + 1) * VELOCITIES])
        seen, polar = _detected(x, places, random)
        false = random.poisson(CLUTTER)
        alarms = [[MAX_RANGE * np.sqrt(random.random()), random.uniform(-HALF_ANGLE, HALF_ANGLE)] for _ in range(false)]
        rows = [(n, *own) for n, own in zip(seen, polar, strict=True) if movers or n < len(STANDING)]
        rows += [(-1, *own) for own in alarms]
        detections = [Detection(range_m=r, bearing_rad=b) for _, r, b in rows]
        keyframes.append(Keyframe.planar(k, motion=STEP, motion_sigmas=STEP_SIGMAS, detections=detections))
        truth.append(x)
        names.append(tuple(n for n, _, _ in rows))
    return MovingWorld(keyframes, np.array(truth), names)


def _detected(x: np.ndarray, places: np.ndarray, random: np.random.Generator) -> tuple[list[int], np.ndarray]:
    """Objects that are detected, and (D, 2) range and bearing of each."""
    offset = places - x[:2]
    polar = np.stack([np.hypot(*offset.T), wrap_angle(np.arctan2(offset[:, 1], offset[:, 0]) - x[2])], axis=1)
    inside = (polar[:, 0] < MAX_RANGE) & (polar[:, 0] > 0.3) & (np.abs(polar[:, 1]) < HALF_ANGLE)
    noisy = polar + random.normal(size=polar.shape) * [SIGMA_RANGE, SIGMA_BEARING]
    seen = np.flatnonzero(inside & (random.random(len(places)) < DETECTION_PROBABILITY))
    return seen.tolist(), noisy[seen]


def configuration(share: float, labels: Sequence[str] = (), **others: Any) -> Configuration:
    """The world as it is, of whose objects a ``share`` is taken to move; ``labels`` of a detector, if it has any."""
    region = {"min_range_m": 0.3, "max_range_m": MAX_RANGE, "field_of_view_rad": 2.0 * HALF_ANGLE}
    rates = {"detection_probability": DETECTION_PROBABILITY, "clutter_per_frame": CLUTTER, "birth_density": 0.05}
    return Configuration.of(
        association="open",
        semantic_model={"kind": "detector", "labels": labels} if labels else {"kind": "none"},
        open_world={"iterate_updates": False, "occluder_radius_m": 0.0, **region, **rates},
        perception={"sigma_range_m": SIGMA_RANGE, "sigma_bearing_rad": SIGMA_BEARING},
        initial_pose={"sigma": [0.01, 0.01, 0.01]},
        moving={"share": share},
        **others,
    )


def run(world: MovingWorld, settings: Configuration) -> tuple[Engine, list[HybridBelief]]:
    """The engine after the drive, and the beliefs."""
    engine = Engine(settings)
    return engine, [engine.process(keyframe) for keyframe in world.keyframes]


def objects_of(engine: Engine, world: MovingWorld) -> dict[int, list[int]]:
    """Object of the best hypothesis -> what its detections are of."""
    found: dict[int, list[int]] = {}
    best = next(iter(engine.live.values()))
    for step, names in zip(best.lineage, world.names, strict=True):
        for object_id, name in zip(step.association, names, strict=True):
            found.setdefault(object_id, []).append(name)
    return found
