"""A small fully connected network in plain numpy, smooth, with exact derivatives of whole batches."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Layer:
    """weight @ x + bias; tanh follows every layer but the last."""

    weight: Array  # (outputs, inputs)
    bias: Array  # (outputs,)


class SmoothNetwork:
    """y = W_n tanh(... tanh(W_1 x + b_1) ...) + b_n."""

    def __init__(self, layers: Sequence[Layer]) -> None:
        """Raises ValueError when the layers do not fit each other."""
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

    @property
    def num_inputs(self) -> int:
        return int(self.layers[0].weight.shape[1])

    @property
    def num_outputs(self) -> int:
        return len(self.layers[-1].weight)

    def value(self, inputs: Array) -> Array:
        """(B, outputs) for (B, inputs)."""
        hidden = inputs
        for layer in self.layers[:-1]:
            hidden = np.tanh(hidden @ layer.weight.T + layer.bias)
        return np.asarray(hidden @ self.layers[-1].weight.T + self.layers[-1].bias)

    def value_and_tangents(self, inputs: Array, tangents: Array) -> tuple[Array, Array]:
        """(B, outputs) and its derivatives (B, outputs, T) along T directions (B, inputs, T) of the input."""
        count, _, directions = tangents.shape
        # One large product per layer instead of B small ones: several times faster.
        hidden = inputs
        slope: Array = tangents.transpose(0, 2, 1).reshape(count * directions, -1)
        for layer in self.layers[:-1]:
            hidden = np.tanh(hidden @ layer.weight.T + layer.bias)
            slope = (slope @ layer.weight.T).reshape(count, directions, -1)
            slope *= (1.0 - hidden**2)[:, None, :]
            slope = slope.reshape(count * directions, -1)
        last = self.layers[-1]
        slope = (slope @ last.weight.T).reshape(count, directions, -1)
        return np.asarray(hidden @ last.weight.T + last.bias), slope.transpose(0, 2, 1)
