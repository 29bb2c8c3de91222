"""A run that summarises its past beside one that keeps all of it: how far its Gaussians are off."""

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from tqdm import tqdm

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam_lab.soak.tour import Tour

PLACE, HEADING = (0, 1), 5
"""Rows of a (6, 6) covariance."""


@dataclass(frozen=True)
class Difference:
    """Largest over the robot's place and heading and all objects' places, in the standard deviations of the whole."""

    shift: float  # of a mean
    least_ratio: float  # of a standard deviation to that of the whole
    largest_ratio: float


def compared(
    configuration: Configuration, num_keyframes: int, seed: int, every: int, map_prior: MapPrior | None = None
) -> list[Difference]:
    """After each ``every`` keyframes of a tour."""
    whole = replace(configuration, history=replace(configuration.history, horizon_keyframes=0))
    engines = Engine(configuration, map_prior), Engine(whole, map_prior)
    found = []
    tour = islice(Tour(configuration, seed).keyframes(), num_keyframes)
    for number, seen in enumerate(tqdm(tour, total=num_keyframes, unit="keyframe"), start=1):
        ours, full = (engine.process(seen.keyframe) for engine in engines)
        if number % every == 0:
            found.append(difference(ours, full))
    return found


def difference(ours: HybridBelief, full: HybridBelief) -> Difference:
    """How far the heaviest hypotheses' robots are off, and the mixtures' objects that both state."""
    _, own, rows = np.intersect1d(ours.object_ids, full.object_ids, return_indices=True)
    shifts, ratios = [], []
    for one, other, covariance, stated in (
        (ours.poses[:1], full.poses[:1], full.pose_covariances[:1], ours.pose_covariances[:1]),
        (ours.object_poses[own], full.object_poses[rows], full.object_covariances[rows], ours.object_covariances[own]),
    ):
        for axis in PLACE:
            sigma = np.sqrt(covariance[:, axis, axis])
            shifts.append(np.abs(one[:, axis] - other[:, axis]) / sigma)
            ratios.append(np.sqrt(stated[:, axis, axis]) / sigma)
    turn = wrap_angle(_yaw(ours.poses[:1]) - _yaw(full.poses[:1]))
    sigma = np.sqrt(full.pose_covariances[:1, HEADING, HEADING])
    shifts.append(np.abs(turn) / sigma)
    ratios.append(np.sqrt(ours.pose_covariances[:1, HEADING, HEADING]) / sigma)
    ratio = np.concatenate(ratios)
    return Difference(float(np.concatenate(shifts).max()), float(ratio.min()), float(ratio.max()))


def _yaw(poses: np.ndarray) -> np.ndarray:
    return np.asarray(2.0 * np.arctan2(poses[:, 5], poses[:, 6]))
