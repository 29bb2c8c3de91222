"""GTSAM factors with a Python callback, which tell what they were made of, as GTSAM cannot write them."""

from collections.abc import Callable, Sequence
from typing import Any

import gtsam

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.linear_factors import unit_noise

Error = Callable[[Any, gtsam.Values, list[Array] | None], Array]
"""Whitened error (m,) at some values; Jacobians by the variables are written to the list, where there is one."""


class _Source(Exception):  # noqa: N818  # no error
    """Carries what a factor was made of out of GTSAM."""

    def __init__(self, source: Any) -> None:
        super().__init__()
        self.source = source


def callback_factor(source: Any, keys: Sequence[int], size: int, error: Error, noise: Any = None) -> Any:
    """A factor of ``size`` whitened residuals; :func:`source_of` returns its ``source``, to make an equal one from.

    ``noise``: GTSAM's noise model of the whitened residuals, with a loss if it has one; None: unit noise.
    """

    def evaluated(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        if values.empty():
            raise _Source(source)
        return error(this, values, jacobians)

    return gtsam.CustomFactor(unit_noise(size) if noise is None else noise, list(keys), evaluated)


def source_of(factor: Any) -> Any:
    """What a factor of :func:`callback_factor` was made of. Raises TypeError for another callback.

    GTSAM does not hand a callback out again; evaluated without values it raises its source.
    """
    try:
        factor.unwhitenedError(gtsam.Values())
    except _Source as told:
        return told.source
    except RuntimeError:
        pass
    raise TypeError("a callback that does not tell what it was made of")
