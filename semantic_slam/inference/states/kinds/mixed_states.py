"""Arithmetic over arrays with one row per state, where robot and landmarks have different state spaces.

A row is as wide as the wider kind; the columns that a narrower state does not use are meaningless. This is the general
path, which gathers and scatters: if robot and landmark share a space, that space itself works on all rows at once.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.kinds.state_space import StateSpace

STORED, TANGENT, FRAME = "storage_size", "tangent_size", "frame_size"
"""Kinds of array columns: names of a state space's attributes that state how many columns it uses."""


@dataclass(frozen=True)
class MixedStates:
    """States (..., N, s): landmarks in the rows from 1 up to ``end`` (None: all), the robot's in the others."""

    robot: StateSpace
    landmark: StateSpace
    end: int | None = None

    def compose(self, state: Array, control: Array) -> Array:
        return self._each("compose", STORED, (state, STORED), (control, STORED))

    def frame(self, state: Array) -> Array:
        return self._each("frame", FRAME, (state, STORED))

    def placed(self, frame: Array, control: Array) -> Array:
        return self._each("placed", STORED, (frame, FRAME), (control, STORED))

    def retract(self, state: Array, tangent: Array) -> Array:
        return self._each("retract", STORED, (state, STORED), (tangent, TANGENT))

    def local(self, state: Array, other: Array) -> Array:
        return self._each("local", TANGENT, (state, STORED), (other, STORED))

    def exp(self, tangent: Array) -> Array:
        return self._each("exp", STORED, (tangent, TANGENT))

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        stored, width = self._width(STORED), self._width(TANGENT)
        moved, chart = np.zeros((*tangent.shape[:-1], stored)), np.zeros((*tangent.shape[:-1], width, width))
        for space, rows in self._kinds(tangent.shape[-2]):
            size = space.tangent_size
            mapped = space.exp_and_jacobian(tangent[..., rows, :size])
            moved[..., rows, : space.storage_size], chart[..., rows, :size, :size] = mapped
        return moved, chart

    def _each(self, name: str, result: str, *operands: tuple[Array, str]) -> Array:
        """Apply a method of each space to its own rows and columns of the operands, given with their column kinds."""
        leading = np.broadcast_shapes(*(values.shape[:-1] for values, _ in operands))
        results = np.zeros((*leading, self._width(result)))
        for space, rows in self._kinds(leading[-1]):
            parts = (values[..., rows, : getattr(space, kind)] for values, kind in operands)
            results[..., rows, : getattr(space, result)] = getattr(space, name)(*parts)
        return results

    def _kinds(self, count: int) -> list[tuple[StateSpace, list[int]]]:
        """Robot and landmark space, each with its rows among ``count`` states."""
        landmarks = list(range(count))[1 : self.end]
        return [(self.robot, [0, *range(1 + len(landmarks), count)]), (self.landmark, landmarks)]

    def _width(self, kind: str) -> int:
        return int(max(getattr(self.robot, kind), getattr(self.landmark, kind)))
