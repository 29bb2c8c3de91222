"""Odometry made of known poses: their increments with noise that is stated."""

import argparse
from itertools import pairwise

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array

DRIFT = 0.03
"""Standard deviation along and across [m] after a metre; it grows with the root of the distance."""
HEADING_DRIFT_RAD = np.deg2rad(0.5)
"""Standard deviation of the heading after a metre, at :data:`DRIFT`."""


def add_drift(parser: argparse.ArgumentParser) -> None:
    """Options ``--drift`` and ``--seed``."""
    parser.add_argument(
        "--drift",
        type=float,
        default=DRIFT,
        metavar="M",
        help="noise of the odometry along and across after a metre [m]; heading in proportion (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the odometry's noise (default: 0)")


def check_drift(arguments: argparse.Namespace) -> None:
    """Raises InputError for noise below zero, or a seed that is none."""
    if not (arguments.drift >= 0.0 and np.isfinite(arguments.drift)):
        raise InputError(f"--drift {arguments.drift}: must be 0 m or more")
    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: must be 0 or more")


def noisy_odometry(poses: Array, drift: float, rng: np.random.Generator) -> Array:
    """(K, 3) poses in odom of a body that drove ``poses`` (K, 3): a random walk over the distance.

    The error of each step is white, in its tangent space, with variance in proportion to the step's length.
    """
    found = [np.zeros(3)]
    for before, after in pairwise(poses):
        step = se2.between(before, after)
        per_root_metre = np.array([drift, drift, HEADING_DRIFT_RAD * drift / DRIFT])
        sigma = per_root_metre * np.sqrt(np.hypot(step[0], step[1]))
        found.append(se2.compose(found[-1], se2.retract(step, sigma * rng.standard_normal(3))))
    return np.array(found)
