"""Memory layout of the coordinates of a robot and n landmarks, and all conversions between its two forms.

Values of 1 + n states have two forms. Joined: concatenated, the robot's r coordinates first, (..., r + n l). In blocks:
one row per state, the robot's first, (..., 1 + n, w) with w = max(r, l), where the narrower kind uses only its first
columns. If robot and landmark have the same size, both forms are the same array in two shapes, without copying.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index


@dataclass(frozen=True)
class Layout:
    """A robot of r coordinates and any number of landmarks of l each; place 0 is the robot, 1 + k landmark k."""

    robot: int  # r
    landmark: int  # l

    @cached_property
    def is_even(self) -> bool:
        """Whether robot and landmark have the same size, so that both forms differ in shape alone."""
        return self.robot == self.landmark

    @cached_property
    def width(self) -> int:
        """The number w of columns of a block."""
        return max(self.robot, self.landmark)

    def size(self, count: int) -> int:
        """Number of coordinates of a robot and ``count`` landmarks."""
        return self.robot + count * self.landmark

    def count(self, size: int) -> int:
        """Number of landmarks, besides the robot, in ``size`` coordinates."""
        return (size - self.robot) // self.landmark

    def block(self, place: int) -> slice:
        """Slice of the coordinates of one state."""
        if place == 0:
            return slice(0, self.robot)
        start = self.size(place - 1)
        return slice(start, start + self.landmark)

    def starts(self, places: Index) -> Index:
        """Index of the first coordinate of each state, in the shape of ``places``."""
        if self.is_even:
            return places * self.robot
        return np.where(places == 0, 0, self.robot + (places - 1) * self.landmark)

    def rows(self, places: Sequence[int] | Index) -> Index:
        """(m,) indices of the coordinates of some states, concatenated."""
        places = np.asarray(places, dtype=int)
        if self.is_even:
            return rows_of_blocks(places, self.robot)
        blocks = map(self.block, places.tolist())
        return np.array([row for block in blocks for row in range(block.start, block.stop)], dtype=int)

    def rows_of_slots(self, places: Index) -> Index:
        """(B, r + n l) indices to gather a robot and n slots from joined values, for places (B, 1 + n), the robot's 0.

        A slot at place 0 has no landmark: its indices are valid, but the gathered values are meaningless.
        """
        if self.is_even:
            return (places[..., None] * self.robot + np.arange(self.robot)).reshape(len(places), -1)
        robots = np.tile(np.arange(self.robot), (len(places), 1))
        slots = (self.starts(places[:, 1:])[..., None] + np.arange(self.landmark)).reshape(len(places), -1)
        return np.concatenate([robots, np.minimum(slots, self.size(int(places.max(initial=0))) - 1)], axis=1)

    def repeated(self, flags: Flags) -> Flags:
        """(..., r + n l) flags per coordinate, from flags (..., 1 + n) per state."""
        if self.is_even:
            return np.repeat(flags, self.robot, axis=-1)
        return np.repeat(flags, [self.robot] + [self.landmark] * (flags.shape[-1] - 1), axis=-1)

    def blocks(self, values: Array, axis: int = -1) -> Array:
        """Joined (..., r + n l, ...) to blocks (..., 1 + n, w, ...); negative ``axis``: that of the coordinates."""
        if self.is_even:
            shape = values.shape
            after = shape[axis + 1 :] if axis < -1 else ()
            return values.reshape(*shape[:axis], shape[axis] // self.width, self.width, *after)
        joined = np.moveaxis(values, axis, -1)
        count = self.count(joined.shape[-1])
        padded = np.zeros((*joined.shape[:-1], 1 + count, self.width))
        padded[..., 0, : self.robot] = joined[..., : self.robot]
        landmarks = joined[..., self.robot :]
        padded[..., 1:, : self.landmark] = landmarks.reshape(*landmarks.shape[:-1], count, self.landmark)
        return np.moveaxis(padded, (-2, -1), (axis - 1, axis))

    def joined(self, blocks: Array, axis: int = -1) -> Array:
        """Blocks (..., 1 + n, w, ...) to joined (..., r + n l, ...); negative ``axis``: that of a block's columns."""
        if self.is_even:
            shape = blocks.shape
            after = shape[axis + 1 :] if axis < -1 else ()
            return blocks.reshape(*shape[: axis - 1], shape[axis - 1] * self.width, *after)
        last = np.moveaxis(blocks, (axis - 1, axis), (-2, -1))
        landmarks = last[..., 1:, : self.landmark]
        flat = landmarks.reshape(*landmarks.shape[:-2], landmarks.shape[-2] * self.landmark)
        return np.moveaxis(np.concatenate([last[..., 0, : self.robot], flat], axis=-1), -1, axis)

    def square_blocks(self, matrix: Array) -> Array:
        """A joined matrix (..., r + n l, r + n l) in blocks (..., 1 + n, w, 1 + n, w)."""
        return self.blocks(self.blocks(matrix), -3)

    def diagonal(self, matrices: Array) -> Array:
        """(B, 1 + n, w, w) diagonal blocks of joined matrices (B, r + n l, r + n l)."""
        if self.is_even:
            return np.asarray(np.einsum("bnpnq->bnpq", self.square_blocks(matrices)))
        r, count = self.robot, self.count(matrices.shape[-1])
        padded = np.zeros((len(matrices), 1 + count, self.width, self.width))
        padded[:, 0, :r, :r] = matrices[:, :r, :r]
        landmarks = matrices[:, r:, r:].reshape(len(matrices), count, self.landmark, count, self.landmark)
        padded[:, 1:, : self.landmark, : self.landmark] = np.einsum("bnpnq->bnpq", landmarks)
        return padded

    def stacked_squares(self, robot: Array, landmarks: Array) -> Array:
        """(1 + n, w, w) blocks, zero where unused, of a robot's (r, r) and landmarks' (n, l, l) covariances."""
        if self.is_even:
            return np.concatenate([robot[None], landmarks])
        padded = np.zeros((1 + len(landmarks), self.width, self.width))
        padded[0, : self.robot, : self.robot] = robot
        padded[1:, : self.landmark, : self.landmark] = landmarks
        return padded

    def stacked(self, robots: Array, landmarks: Array) -> Array:
        """Stack robots (..., a, r) and landmarks (..., n, l), or values already in blocks, to (..., a + n, w)."""
        if self.is_even:
            return np.concatenate([robots, landmarks], axis=-2)
        return np.concatenate([self._wide(robots), self._wide(landmarks)], axis=-2)

    def _wide(self, values: Array) -> Array:
        padded = np.zeros((*values.shape[:-1], self.width))
        padded[..., : values.shape[-1]] = values
        return padded


def rows_of_blocks(places: Sequence[int] | Index, size: int) -> Index:
    """(n size,) indices of the coordinates of blocks at ``places`` (n,), all of the same size."""
    return np.asarray((np.asarray(places, dtype=int)[:, None] * size + np.arange(size)).ravel())
