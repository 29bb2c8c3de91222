"""Small fully connected tanh network in plain numpy, with exact batched derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from semantic_slam.geometry.arrays import Array, row_products


@dataclass(frozen=True)
class Layer:
    """Affine layer weight @ x + bias; tanh follows every layer but the last."""

    weight: Array  # (outputs, inputs)
    bias: Array  # (outputs,)


class SmoothNetwork:
    """Multilayer perceptron y = W_n tanh(... tanh(W_1 x + b_1) ...) + b_n."""

    def __init__(self, layers: Sequence[Layer]) -> None:
        """Validate and store the layers. Raises ValueError when their sizes do not fit together."""
        if not layers:
            raise ValueError("a network needs a layer")
        for before, after in pairwise(layers):
            if after.weight.shape[1] != len(before.weight):
                raise ValueError(
                    f"a layer of {len(before.weight)} outputs is followed by {after.weight.shape[1]} inputs"
                )
        if any(layer.bias.shape != (len(layer.weight),) for layer in layers):
            raise ValueError("a bias does not fit its weight")
        self.layers = tuple(layers)
        self._by_input = [np.ascontiguousarray(layer.weight.T) for layer in layers]  # a third faster to multiply by

    @property
    def num_inputs(self) -> int:
        return int(self.layers[0].weight.shape[1])

    @property
    def num_outputs(self) -> int:
        return len(self.layers[-1].weight)

    def value(self, inputs: Array) -> Array:
        """(B, outputs) network output at (B, inputs)."""
        hidden = inputs
        for layer, by_input in zip(self.layers[:-1], self._by_input[:-1], strict=True):
            hidden = np.tanh(row_products(hidden, by_input) + layer.bias)
        return row_products(hidden, self._by_input[-1]) + self.layers[-1].bias

    def value_and_tangents(self, inputs: Array, tangents: Array) -> tuple[Array, Array]:
        """(B, outputs) output and its directional derivatives (B, T, outputs) along T tangents (B, T, inputs)."""
        shape = (len(tangents), 1 + tangents.shape[1], -1)
        # One large product per layer for values and tangents, several times faster than many small ones.
        rows = np.concatenate([inputs[:, None], tangents], axis=1).reshape(shape[0] * shape[1], -1)
        for layer, by_input in zip(self.layers[:-1], self._by_input[:-1], strict=True):
            rows = row_products(rows, by_input)
            split = rows.reshape(shape)
            hidden = np.tanh(split[:, 0] + layer.bias)
            split *= (1.0 - hidden * hidden)[:, None]
            split[:, 0] = hidden
        split = row_products(rows, self._by_input[-1]).reshape(shape)
        return split[:, 0] + self.layers[-1].bias, split[:, 1:]
