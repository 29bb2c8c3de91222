"""What anyone could know of displaced objects: their posterior given what each detection is of, about the truth.

No estimator that goes by the same models, and has to find out the associations besides, can name more on average.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.linalg import block_diag

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.evidence.displaced import Displacement
from semantic_slam_lab.studies.faulty_rooms.closed_room import (
    HEADING_RAD,
    LOST_M,
    SIGMA_BEARING_RAD,
    SIGMA_RANGE_M,
    SIGMA_STEP,
)
from semantic_slam_lab.studies.faulty_rooms.faults import FaultyRoom

STEP = 1e-6
"""Width of a numerical slope, metres and radians."""


def moved_if_associations_were_known(faulty: FaultyRoom, share: float, sigma_m: float) -> Array:
    """(O,) posterior probability that each object of the map was moved; geometry alone, linear about the truth."""
    room = faulty.room
    poses, places = room.truth, room.objects[:, :2]
    states = np.concatenate([poses.ravel(), places.ravel()])
    information, vector = np.zeros((len(states), len(states))), np.zeros(len(states))
    for columns, residual, sigmas in _residuals(faulty):
        values = states[columns]
        known = residual(values)
        slopes = np.array([residual(values + STEP * unit) - known for unit in np.eye(len(values))]).T / STEP
        slopes, known = slopes / sigmas[:, None], known / sigmas
        information[np.ix_(columns, columns)] += slopes.T @ slopes
        vector[columns] -= slopes.T @ known
    mapped = np.array([item.pose[:2] for item in room.prior.objects])
    priors = np.array([item.covariance[:2, :2] for item in room.prior.objects])
    first = 3 * len(poses)
    for number, (offset, prior) in enumerate(zip(mapped - places, priors, strict=True)):
        own = slice(first + 2 * number, first + 2 * number + 2)
        information[own, own] += np.linalg.inv(prior)
        vector[own] += np.linalg.solve(prior, offset)
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    estimate = places + (covariance @ vector)[first:].reshape(-1, 2)
    return Displacement(
        offset=estimate - mapped,
        covariance=covariance[first:, first:],
        prior=block_diag(*priors),
        taken=np.zeros(len(priors), dtype=bool),
        weighed=np.arange(len(priors)),
        share=share,
        sigma_m=sigma_m,
    ).probabilities()


Residual = tuple[list[int], Callable[[Array], Array], Array]
"""Which states it is of, what it is, and its standard deviations."""


def _residuals(faulty: FaultyRoom) -> list[Residual]:
    room = faulty.room
    first = 3 * len(room.truth)
    found: list[Residual] = [([0, 1, 2], partial(_apart, room.start), np.array([LOST_M, LOST_M, HEADING_RAD]))]
    for k, keyframe in enumerate(room.keyframes):
        if k:
            told = planar_from_pose_vector(keyframe.odometry)
            found.append((list(range(3 * k - 3, 3 * k + 3)), partial(_slip, told), SIGMA_STEP))
        seen = keyframe.measurements
        for row, number in enumerate(faulty.wrong_at(k)):
            if number is None:
                continue
            columns = [3 * k, 3 * k + 1, 3 * k + 2, first + 2 * number, first + 2 * number + 1]
            polar = np.array([seen.ranges_m[row], seen.bearings_rad[row]])
            sigmas = np.array([SIGMA_RANGE_M, SIGMA_BEARING_RAD])
            found.append((columns, partial(_off, polar), sigmas))
    return found


def _apart(start: Array, states: Array) -> Array:
    return states - start


def _slip(told: Array, states: Array) -> Array:
    return np.asarray(se2.between(told, se2.between(states[:3], states[3:])))


def _off(polar: Array, states: Array) -> Array:
    apart = states[3:] - states[:2]
    return np.array([np.hypot(*apart) - polar[0], wrap_angle(np.arctan2(apart[1], apart[0]) - states[2] - polar[1])])
