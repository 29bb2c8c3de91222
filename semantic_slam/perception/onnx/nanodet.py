"""NanoDet's layout: two outputs for each grid of cells, scores and distances to the edges."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from semantic_slam.geometry.arrays import Array, Bytes

MEAN_BGR = (103.53, 116.28, 123.675)
SCALE_BGR = (57.375, 57.12, 58.395)
"""Channel scales (BGR) of NanoDet's input normalisation: (pixel - mean) / scale."""
EDGES = 4
"""Number of regressed distances per box: left, top, right and bottom edge from the cell centre."""


@dataclass(frozen=True)
class NanoDet:
    """Layout of NanoDet: all grids' (1, cells, C) scores, then all grids' (1, cells, 4 B) logits of distances."""

    size: tuple[int, int]  # height and width of the input, pixels

    grey: ClassVar[int] = 0

    @classmethod
    def of(cls, outputs: Sequence[Array], num_classes: int, size: tuple[int, int]) -> "NanoDet | None":
        """Recognise the layout by the shapes of the outputs; None: they are of another."""
        layout = cls(size)
        is_paired = len(outputs) % 2 == 0 and all(output.ndim == 3 and len(output) == 1 for output in outputs)
        return layout if is_paired and all(layout._fits(*pair, num_classes) for pair in _pairs(outputs)) else None

    def _fits(self, scores: Array, logits: Array, num_classes: int) -> bool:
        rows, columns, _ = self._grid(len(scores))
        is_grid = rows * columns == len(scores) == len(logits)
        return is_grid and scores.shape[1] == num_classes and logits.shape[1] % EDGES == 0

    def normalised(self, pixels: Bytes) -> Array:
        return np.asarray((pixels[..., ::-1] - np.array(MEAN_BGR)) / np.array(SCALE_BGR))

    def boxes(self, outputs: Sequence[Array]) -> tuple[Array, Array]:
        """Decode the boxes of all cells.

        A distance is the mean over the bins 0 .. B - 1, in cells (generalized focal loss, Li et al. 2020, Eq. 5).
        """
        boxes, scores = [], []
        for cell_scores, logits in _pairs(outputs):
            _, columns, side = self._grid(len(cell_scores))
            cells = np.arange(len(cell_scores))
            centres = (np.stack([cells % columns, cells // columns], axis=1) + 0.5) * side
            reach = _mean_bins(logits.reshape(len(logits), EDGES, -1)) * side
            boxes.append(np.concatenate([centres - reach[:, :2], centres + reach[:, 2:]], axis=1))
            scores.append(cell_scores)
        return np.concatenate(boxes), np.concatenate(scores)

    def _grid(self, num_cells: int) -> tuple[int, int, float]:
        """Rows and columns of the grid of square cells, and the side of one in pixels of the input."""
        height, width = self.size
        side = (height * width / num_cells) ** 0.5
        return round(height / side), round(width / side), side


def _pairs(outputs: Sequence[Array]) -> list[tuple[Array, Array]]:
    """(cells, C) scores and (cells, 4 B) logits of every grid."""
    paired = len(outputs) // 2
    return [(scores[0], logits[0]) for scores, logits in zip(outputs[:paired], outputs[paired:], strict=True)]


def _mean_bins(logits: Array) -> Array:
    """(N, 4) expected bin numbers under the softmax of (N, 4, B) logits."""
    weights = np.exp(logits - logits.max(axis=-1, keepdims=True))
    return np.asarray(weights @ np.arange(logits.shape[-1]) / weights.sum(axis=-1))
