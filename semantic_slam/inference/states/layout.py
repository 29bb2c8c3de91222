"""Where the coordinates of a robot and of n landmarks stand in one vector: all arithmetic of blocks.

Values of 1 + n states have two forms. Joined, they stand one after another, the robot's r first: (..., r + n l). In
blocks each state has a row, the robot's first: (..., 1 + n, w) with w = max(r, l), of which the narrower kind uses its
own first columns only. Where robot and landmark are of one size, both forms are one array in two shapes, and nothing
is copied.
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
        """Whether robot and landmark have one size, so that blocks are a matter of shape alone."""
        return self.robot == self.landmark

    @cached_property
    def width(self) -> int:
        """w, columns of a block."""
        return max(self.robot, self.landmark)

    def size(self, count: int) -> int:
        """Coordinates of a robot and ``count`` landmarks."""
        return self.robot + count * self.landmark

    def count(self, size: int) -> int:
        """Landmarks besides the robot in ``size`` coordinates."""
        return (size - self.robot) // self.landmark

    def block(self, place: int) -> slice:
        """Coordinates of one state."""
        if place == 0:
            return slice(0, self.robot)
        start = self.size(place - 1)
        return slice(start, start + self.landmark)

    def starts(self, places: Index) -> Index:
        """The first coordinate of each state, in the shape of ``places``."""
        if self.is_even:
            return places * self.robot
        return np.where(places == 0, 0, self.robot + (places - 1) * self.landmark)

    def rows(self, places: Sequence[int] | Index) -> Index:
        """(m,) coordinates of some states, one after another."""
        places = np.asarray(places, dtype=int)
        if self.is_even:
            return rows_of_blocks(places, self.robot)
        blocks = map(self.block, places.tolist())
        return np.array([row for block in blocks for row in range(block.start, block.stop)], dtype=int)

    def rows_of_slots(self, places: Index) -> Index:
        """(B, r + n l) coordinates that a robot and n slots read, (B, 1 + n) places, the robot's being 0.

        A slot at place 0 has no landmark: what it reads means nothing, but can be read.
        """
        if self.is_even:
            return (places[..., None] * self.robot + np.arange(self.robot)).reshape(len(places), -1)
        robots = np.tile(np.arange(self.robot), (len(places), 1))
        slots = (self.starts(places[:, 1:])[..., None] + np.arange(self.landmark)).reshape(len(places), -1)
        return np.concatenate([robots, np.minimum(slots, self.size(int(places.max(initial=0))) - 1)], axis=1)

    def repeated(self, flags: Flags) -> Flags:
        """(..., r + n l) the flag (..., 1 + n) of its state for each coordinate."""
        if self.is_even:
            return np.repeat(flags, self.robot, axis=-1)
        return np.repeat(flags, [self.robot] + [self.landmark] * (flags.shape[-1] - 1), axis=-1)

    def blocks(self, values: Array, axis: int = -1) -> Array:
        """(..., 1 + n, w, ...) of (..., r + n l, ...), the negative ``axis`` being that of the coordinates."""
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
        """(..., r + n l, ...) of (..., 1 + n, w, ...), the negative ``axis`` being that of a block's columns."""
        if self.is_even:
            shape = blocks.shape
            after = shape[axis + 1 :] if axis < -1 else ()
            return blocks.reshape(*shape[: axis - 1], shape[axis - 1] * self.width, *after)
        last = np.moveaxis(blocks, (axis - 1, axis), (-2, -1))
        landmarks = last[..., 1:, : self.landmark]
        flat = landmarks.reshape(*landmarks.shape[:-2], landmarks.shape[-2] * self.landmark)
        return np.moveaxis(np.concatenate([last[..., 0, : self.robot], flat], axis=-1), -1, axis)

    def square_blocks(self, matrix: Array) -> Array:
        """(..., 1 + n, w, 1 + n, w) of (..., r + n l, r + n l)."""
        return self.blocks(self.blocks(matrix), -3)

    def diagonal(self, matrices: Array) -> Array:
        """(B, 1 + n, w, w) the states' own blocks of (B, r + n l, r + n l)."""
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
        """(..., a + n, w) of (..., a, r) and (..., n, l), or of what is in blocks already."""
        if self.is_even:
            return np.concatenate([robots, landmarks], axis=-2)
        return np.concatenate([self._wide(robots), self._wide(landmarks)], axis=-2)

    def _wide(self, values: Array) -> Array:
        padded = np.zeros((*values.shape[:-1], self.width))
        padded[..., : values.shape[-1]] = values
        return padded


def rows_of_blocks(places: Sequence[int] | Index, size: int) -> Index:
    """(n size,) coordinates of the blocks at ``places`` (n,), which are all of one size."""
    return np.asarray((np.asarray(places, dtype=int)[:, None] * size + np.arange(size)).ravel())
