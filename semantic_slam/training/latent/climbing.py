"""Levenberg-Marquardt for many small problems at once."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array

Terms = Callable[[Array], tuple[Array, Array, Array]]
"""(B, S) states to (B,) costs, (B, S) descent directions and (B, S, S) information."""


@dataclass(frozen=True)
class Climbed:
    """Ends of B ascents."""

    state: Array  # (B, S)
    cost: Array  # (B,)
    information: Array  # (B, S, S)

    def or_better(self, other: "Climbed") -> "Climbed":
        """Of both ends the cheaper one, problem by problem."""
        better = other.cost < self.cost
        return Climbed(
            np.where(better[:, None], other.state, self.state),
            np.where(better, other.cost, self.cost),
            np.where(better[:, None, None], other.information, self.information),
        )


def climb(terms: Terms, start: Array, iterations: int) -> Climbed:
    """From (B, S) starts; every problem has its own damping and takes only steps that help."""
    state, identity = start.copy(), np.eye(start.shape[1])
    damping = np.full(len(start), 1e-2)
    cost, gradient, information = terms(state)
    for _ in range(iterations):
        diagonal = np.diagonal(information, axis1=1, axis2=2)[:, :, None] * identity
        step = np.linalg.solve(information + damping[:, None, None] * diagonal, gradient[:, :, None])[:, :, 0]
        tried = state + step
        new_cost, new_gradient, new_information = terms(tried)
        better = new_cost < cost
        state, cost = np.where(better[:, None], tried, state), np.where(better, new_cost, cost)
        gradient = np.where(better[:, None], new_gradient, gradient)
        information = np.where(better[:, None, None], new_information, information)
        damping = np.clip(np.where(better, damping / 4.0, damping * 5.0), 1e-8, 1e8)
    return Climbed(state, cost, information)
