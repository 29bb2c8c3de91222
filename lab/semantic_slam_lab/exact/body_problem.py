"""A robot in SE(3) among objects in SE(3) whose scores depend on class and viewpoint, as densities alone.

Beside what :mod:`spatial_problem` says: o = mean Exp(L_o y_o), and the scores of an object of class c are Gaussian
about h_c of Eq. 4.22 over the angle between its front, its own x, and the camera at the body's origin.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from semantic_slam_lab.exact.spatial_problem import Array, History, SpatialProblem, States, moved, pose

Assignment = tuple[History, tuple[int, ...]]
"""Associations of all detections, and the class of every object."""
NUM_CLASSES = 2


@dataclass(frozen=True)
class BodyProblem(SpatialProblem):
    """The ``input`` of a fixture of schema exact-ch4-se3-bodies/1, whose detections see every object."""

    degrees = 6

    def explanations(self) -> list[Any]:
        """Every association with every class of all objects."""
        classes = list(product(range(NUM_CLASSES), repeat=self.num_points))
        return [(history, own) for history in self.histories() for own in classes]

    def described(self, explanation: Any) -> dict[str, Any]:
        """An assignment as a fixture has it."""
        return {"beta": explanation[0], "C": explanation[1]}

    def states(self, y: Array) -> States:
        """All states of deviations (B, size)."""
        turns, places = self.robots(y)
        given, deviations = self.given, y[:, 6 * (1 + self.num_keyframes) :].reshape(len(y), -1, 6)
        objects = [
            moved(pose(mean, len(y)), np.sqrt(given["So"]) * deviations[:, number])
            for number, mean in enumerate(given["objects"])
        ]
        points = np.stack([place for _, place in objects], axis=1)
        return States(turns, places, points, [turn for turn, _ in objects])

    def scores_off(self, states: States, assignment: Assignment) -> Array:
        """(B, 2 n) scores less their means, in standard deviations."""
        history, classes = assignment
        root = self.given["Ksem"] * np.array([[1.0, -0.5], [0.0, 1.0]])
        columns = []
        for place, frame, association in zip(states.places, self.given["Z"], history, strict=True):
            for seen, number in zip(frame, association, strict=True):
                camera = states.object_turns[number].inv().apply(place - states.points[:, number])
                cosine = camera[:, 0] / np.linalg.norm(camera, axis=1)
                columns.append((np.asarray(seen["sem"]) - self.expected(cosine, classes[number])) @ root.T)
        return np.concatenate(columns, axis=1)

    def expected(self, cosine: Array, assigned: int) -> Array:
        """(B, 2) h_c of Eq. 4.22 by the cosines (B,) of the angle off the front."""
        half_sine = 0.5 * (1.0 - cosine)  # sin^2(t / 2)
        alpha = self.given["alpha"]
        first = np.stack([alpha * half_sine + 1.0 - alpha, alpha - alpha * half_sine], axis=1)
        return first if assigned == 0 else first[:, ::-1]

    def residuals_of(self, states: States, assignment: Assignment) -> Array:
        """(B, m) of geometry and of scores."""
        return np.concatenate([self.residuals(states, assignment[0]), self.scores_off(states, assignment)], axis=1)

    def log_density(self, states: States, assignment: Assignment) -> Array:
        """(B,) log density of all detections with their scores, and of the classes before them."""
        count = sum(map(len, self.given["Z"]))
        log_normaliser = count * float(2.0 * np.log(self.given["Ksem"]) - np.log(2.0 * np.pi))
        log_prior = -self.num_points * float(np.log(NUM_CLASSES))
        off = 0.5 * (self.scores_off(states, assignment) ** 2).sum(axis=1)
        return np.asarray(self.log_likelihood(states, assignment[0]) + log_normaliser + log_prior - off)
