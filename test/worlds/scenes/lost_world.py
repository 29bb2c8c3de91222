"""A robot on a circle among points that all look alike: it has a map of them, and does not know where it is."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

STEP, STEP_SIGMAS = np.array([0.4, 0.0, 0.1]), np.array([0.02, 0.02, 0.01])
SIGMA_RANGE, SIGMA_BEARING = 0.05, 0.02
MAX_RANGE, HALF_ANGLE = 8.0, 1.6
LOST = (10.0, 10.0, 3.14)
PLACES = np.array(
    [[3.0, 1.0], [3.2, 1.15], [6.0, -3.0], [-1.0, 6.0], [-1.2, 6.1], [7.5, 4.0], [2.0, 9.0], [-4.0, 2.0]],
)
"""Two of them are pairs 0.25 m apart."""
SYMMETRIC = np.array([[3.0, 1.0], [5.0, -2.5], [-1.0, 4.0], [4.5, 4.0]])
SYMMETRIC = np.concatenate([SYMMETRIC, -SYMMETRIC])
"""Alike after half a turn about the origin."""


@dataclass(frozen=True)
class LostWorld:
    """K keyframes."""

    keyframes: list[Keyframe]
    truth: np.ndarray  # (K, 3) in map
    names: list[tuple[int, ...]]  # number on the map of every detection


def make_world(start: np.ndarray, num_keyframes: int, *, places: np.ndarray = PLACES, seed: int = 0) -> LostWorld:
    """From the pose ``start`` (3,) in map, before the first motion; every point inside the region is detected."""
    random = np.random.default_rng(seed)
    keyframes, truth, names, x = [], [], [], start
    for k in range(num_keyframes):
        x = se2.compose(se2.compose(x, STEP), se2.exp(random.normal(size=3) * STEP_SIGMAS))
        offset = places - x[:2]
        polar = np.stack([np.hypot(*offset.T), wrap_angle(np.arctan2(offset[:, 1], offset[:, 0]) - x[2])], axis=1)
        seen = np.flatnonzero((polar[:, 0] < MAX_RANGE) & (polar[:, 0] > 0.3) & (np.abs(polar[:, 1]) < HALF_ANGLE))
        noisy = polar[seen] + random.normal(size=(len(seen), 2)) * [SIGMA_RANGE, SIGMA_BEARING]
        detections = [Detection(range_m=r, bearing_rad=b) for r, b in noisy.tolist()]
        keyframes.append(Keyframe.planar(k, motion=STEP, motion_sigmas=STEP_SIGMAS, detections=detections))
        truth.append(x)
        names.append(tuple(seen.tolist()))
    return LostWorld(keyframes, np.array(truth), names)


def carried_world(
    start: np.ndarray,
    there: np.ndarray,
    before: int,
    after: int,
    *,
    places: np.ndarray = PLACES,
    new: np.ndarray | None = None,
) -> LostWorld:
    """A drive of ``before`` keyframes among ``places``, and another one from elsewhere, to which the robot is carried.

    ``new``: the places that it drives among there; None: the same ones.
    """
    other = make_world(there, after, places=places if new is None else new, seed=1)
    worlds = make_world(start, before, places=places), other
    first, second = (own.keyframes for own in worlds)
    apart_ns = first[1].stamp_ns - first[0].stamp_ns
    moved = [replace(own, index=own.index + before, stamp_ns=own.stamp_ns + before * apart_ns) for own in second]
    truth = np.concatenate([own.truth for own in worlds])
    return LostWorld([*first, *moved], truth, [*worlds[0].names, *worlds[1].names])


def map_of(places: np.ndarray = PLACES) -> MapPrior:
    """The points, each to a centimetre."""
    rows = enumerate(places.tolist())
    return MapPrior(tuple(ObjectPrior.planar(n, x, y, sigma_m=0.01, sigma_rad=1.0) for n, (x, y) in rows))


def configuration(*, rates: dict[str, float] | None = None, **others: Any) -> Configuration:
    """The world as it is; where the robot begins is known to ten metres, and no heading."""
    region = {"min_range_m": 0.3, "max_range_m": MAX_RANGE, "field_of_view_rad": 2.0 * HALF_ANGLE}
    stated = {"detection_probability": 0.9, "clutter_per_frame": 0.01, "birth_density": 0.03, **(rates or {})}
    settings = {
        "association": "open",
        "semantic_model": {"kind": "none"},
        "open_world": {"iterate_updates": False, "occluder_radius_m": 0.0, **region, **stated},
        "perception": {"sigma_range_m": SIGMA_RANGE, "sigma_bearing_rad": SIGMA_BEARING},
        "initial_pose": {"sigma": list(LOST)},
        "revision": {"lost_every_keyframes": 2},
        "pruning": {"max_hypotheses": 10},
        "weights": {"max_candidates": 20},
    }
    return Configuration.of(**{**settings, **others})


def run(world: LostWorld, settings: Configuration, places: np.ndarray = PLACES) -> tuple[Engine, list[HybridBelief]]:
    """The engine after the drive, and the beliefs."""
    engine = Engine(settings, map_of(places))
    return engine, [engine.process(keyframe) for keyframe in world.keyframes]


def errors(belief: HybridBelief, true_pose: np.ndarray) -> np.ndarray:
    """(H,) metres between each hypothesis's robot and the true one."""
    return np.asarray(np.hypot(*(planar_from_pose_vector(belief.poses)[:, :2] - true_pose[:2]).T))
