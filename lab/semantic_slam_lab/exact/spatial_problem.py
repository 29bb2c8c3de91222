"""A robot in SE(3) among points in R^3 as densities alone, written out apart from the engine (rotations by SciPy).

All states follow from whitened deviations y ~ N(0, I): x_0 = mean Exp(L y_0), x_k = x_k-1 u_k Exp(L_w y_k) and
o = mean + L_o y_o, with tangent vectors [rotation, translation]. A detection is a range and a unit ray in the body
frame, Gaussian in the distance and in the angle between the ray and the point.
"""

from dataclasses import dataclass, field
from itertools import permutations, product
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
History = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class States:
    """B samples of all states of K keyframes and N points."""

    turns: list[Rotation]  # K of B
    places: list[Array]  # K of (B, 3)
    points: Array  # (B, N, 3)
    object_turns: list[Rotation] = field(default_factory=list)  # N of B, where objects have an attitude


@dataclass(frozen=True)
class SpatialProblem:
    """The ``input`` of a fixture of schema exact-ch4-se3/1."""

    given: dict[str, Any]

    degrees: ClassVar[int] = 3  # of an object

    @property
    def num_points(self) -> int:
        return len(self.given["objects"])

    @property
    def num_keyframes(self) -> int:
        return len(self.given["u"])

    @property
    def size(self) -> int:
        """Deviations of all states."""
        return 6 * (1 + self.num_keyframes) + self.degrees * self.num_points

    def histories(self) -> list[History]:
        """Every association of all detections; one point takes at most one of a frame."""
        frames = [permutations(range(self.num_points), len(frame)) for frame in self.given["Z"]]
        return [tuple(own) for own in product(*frames)]

    def states(self, y: Array) -> States:
        """All states of deviations (B, size)."""
        turns, places = self.robots(y)
        points = y[:, 6 * (1 + self.num_keyframes) :].reshape(len(y), -1, 3)
        return States(turns, places, np.asarray(self.given["objects"]) + np.sqrt(self.given["So"]) * points)

    def robots(self, y: Array) -> tuple[list[Rotation], list[Array]]:
        """Turns and places (B, 3) of all keyframes at deviations (B, size)."""
        given, sigma_step = self.given, np.sqrt(self.given["Sw"])
        turn, place = moved(pose(given["x0"], len(y)), np.sqrt(given["Sp"]) * y[:, :6])
        turns, places = [], []
        for k, control in enumerate(given["u"]):
            driven = _composed((turn, place), pose(control, len(y)))
            turn, place = moved(driven, sigma_step * y[:, 6 * (k + 1) : 6 * (k + 2)])
            turns.append(turn)
            places.append(place)
        return turns, places

    def residuals(self, states: States, history: History) -> Array:
        """(B, 2 n) [range, angle] of every detection of its point, in standard deviations."""
        by_range, by_ray, _ = np.sqrt(self.given["Sv"])
        columns = []
        for turn, place, frame, association in zip(states.turns, states.places, self.given["Z"], history, strict=True):
            for seen, number in zip(frame, association, strict=True):
                body = turn.inv().apply(states.points[:, number] - place)
                distance, ray = np.linalg.norm(body, axis=1), np.asarray(seen["ray"])
                angle = np.arctan2(np.linalg.norm(np.cross(body, ray), axis=1), body @ ray)
                columns += [(distance - seen["range"]) / by_range, angle / by_ray]
        return np.stack(columns, axis=1)

    def explanations(self) -> list[Any]:
        """All that the detections may be of, each with a log density of its own."""
        return self.histories()

    def described(self, explanation: Any) -> dict[str, Any]:
        """An explanation as a fixture has it."""
        return {"beta": explanation}

    def residuals_of(self, states: States, history: Any) -> Array:
        """(B, m) of all that is measured under a history, in standard deviations."""
        return self.residuals(states, history)

    def log_density(self, states: States, history: Any) -> Array:
        """(B,) log density of all that is measured under a history."""
        return self.log_likelihood(states, history)

    def log_likelihood(self, states: States, history: History) -> Array:
        """(B,) log density of all detections."""
        count = sum(map(len, self.given["Z"]))
        log_normaliser = -0.5 * count * float(np.log(2.0 * np.pi * np.array(self.given["Sv"])).sum())
        return np.asarray(log_normaliser - 0.5 * (self.residuals(states, history) ** 2).sum(axis=1))


def pose(values: list[float], count: int) -> tuple[Rotation, Array]:
    """Turn and place (count, 3) of x y z qx qy qz qw, repeated."""
    return Rotation.from_quat(np.tile(values[3:], (count, 1))), np.tile(values[:3], (count, 1))


def _composed(pose: tuple[Rotation, Array], other: tuple[Rotation, Array]) -> tuple[Rotation, Array]:
    return pose[0] * other[0], pose[1] + pose[0].apply(other[1])


def moved(state: tuple[Rotation, Array], tangent: Array) -> tuple[Rotation, Array]:
    """state Exp(tangent), the integral of the turn along the way written out."""
    w, v = tangent[:, :3], tangent[:, 3:]
    angle = np.linalg.norm(w, axis=1, keepdims=True) + 1e-12
    axis = w / angle
    along = axis * (axis * v).sum(axis=1, keepdims=True)
    shift = np.sin(angle) / angle * (v - along) + along + (1.0 - np.cos(angle)) / angle * np.cross(axis, v)
    return _composed(state, (Rotation.from_rotvec(w), shift))
