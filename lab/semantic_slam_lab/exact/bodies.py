"""An exact answer among objects with an attitude, class and viewpoint: python -m semantic_slam_lab.exact.bodies FILE.

By importance sampling as :mod:`semantic_slam_lab.exact.spatial` does it.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from semantic_slam_lab.exact.body_problem import BodyProblem
from semantic_slam_lab.exact.spatial import seen_along, write

SEEN, CLASSES = ((0, 1), (1, 0)), (0, 1)
"""Which object each detection is truly of, and of what class these are."""


def problem(seed: int = 5) -> BodyProblem:
    """Two upright objects within reach of each other's uncertainty, seen together by a robot that flies above them."""
    random = np.random.default_rng(seed)
    step = [0.5, 0.15, 0.1, *Rotation.from_rotvec([0.05, 0.1, 0.25]).as_quat().tolist()]
    given: dict[str, Any] = {
        "x0": [0.1, -0.1, 1.2, *Rotation.from_rotvec([0.1, 0.35, 0.3]).as_quat().tolist()],
        "Sp": [0.004, 0.004, 0.03, 0.06, 0.06, 0.03],
        "objects": [
            [1.9, 0.9, 0.3, *Rotation.from_rotvec([0.0, 0.0, 2.4]).as_quat().tolist()],
            [2.3, 0.3, 0.5, *Rotation.from_rotvec([0.0, 0.0, -1.9]).as_quat().tolist()],
        ],
        "So": [0.0004, 0.0004, 0.06, 0.05, 0.05, 0.02],
        "u": [step, step],
        "Sw": [0.001, 0.001, 0.002, 0.0025, 0.0025, 0.0025],
        "Sv": [0.04, 0.0225, 0.0225],
        "alpha": 0.7,
        "Ksem": 5.0,
        "exclusive": True,
        "Z": [[{"range": 1.0, "ray": [1.0, 0.0, 0.0]}] * len(frame) for frame in SEEN],
    }
    drawn = BodyProblem(given)
    truth = drawn.states(random.standard_normal((1, drawn.size)))
    by_range, by_ray, _ = np.sqrt(given["Sv"])
    unscored = given["Ksem"] * np.array([[1.0, -0.5], [0.0, 1.0]])
    given["Z"] = [[] for _ in SEEN]
    for turn, place, frame, told in zip(truth.turns, truth.places, SEEN, given["Z"], strict=True):
        for n in frame:
            seen = seen_along(turn.inv().apply(truth.points[0, n] - place)[0], by_range, by_ray, random)
            camera = truth.object_turns[n].inv().apply(place - truth.points[:, n])
            mean = drawn.expected(camera[:, 0] / np.linalg.norm(camera, axis=1), CLASSES[n])[0]
            told.append({**seen, "sem": (mean + np.linalg.solve(unscored, random.standard_normal(2))).tolist()})
    return drawn


if __name__ == "__main__":
    write(problem(), Path(sys.argv[1]), "exact-ch4-se3-bodies/1", "SE3 and SE3, N2 k2 n2, two classes")
