"""Gaussian process of one class: training views and hyperparameters (Eqs. 3.8-3.12)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class ClassModel:
    """M training views of one class with inputs of D dimensions; F feature components, each with its own process.

    The prior mean is zero. Raises InputError where the arrays do not fit together.
    """

    inputs: Array  # (M, D), X_T
    scores: Array  # (M, F), S_T
    signal_variance: Array  # (F,), sigma^2 of the kernel
    length_squared: Array  # (F, D, D), L of the kernel, in squared units of the inputs
    noise_sigma: Array  # (F,), sigma_n: standard deviation of a score about the process

    def __post_init__(self) -> None:
        views, size = np.shape(self.scores) if np.ndim(self.scores) == 2 else (-1, -1)
        dimension = np.shape(self.inputs)[-1] if np.ndim(self.inputs) == 2 else -1
        expected = {
            "inputs": (views, dimension),
            "signal_variance": (size,),
            "length_squared": (size, dimension, dimension),
            "noise_sigma": (size,),
        }
        for name, shape in expected.items():
            value = getattr(self, name)
            if np.shape(value) != shape or not np.all(np.isfinite(value)):
                raise InputError(f"class model: '{name}' is {np.shape(value)}, wanted are finite numbers of {shape}")
        if np.any(self.signal_variance <= 0.0) or np.any(np.linalg.eigvalsh(self.length_squared) <= 0.0):
            raise InputError("class model: sigma2 and L have to be positive (definite); correct them")

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> "ClassModel":
        """A class model from an object with X_T, S_T, sigma2, L and sigma_n; raises InputError."""
        try:
            values = [np.array(row[name], dtype=np.float64) for name in ("X_T", "S_T", "sigma2", "L", "sigma_n")]
        except (KeyError, TypeError, ValueError) as fault:
            raise InputError(f"class model: {fault!r}; X_T, S_T, sigma2, L and sigma_n are needed") from None
        return cls(*values)
