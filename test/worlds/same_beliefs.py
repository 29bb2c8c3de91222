"""When two beliefs say the same, whichever world they are of."""

import dataclasses

import numpy as np

from semantic_slam.inference.belief import HybridBelief

SUBSTANCE = [field.name for field in dataclasses.fields(HybridBelief) if field.name != "dropped"]


def assert_same(first: HybridBelief, second: HybridBelief) -> None:
    """To 1e-9 in every number, and exactly in what is no number; how much was dropped does not count."""
    for name in SUBSTANCE:
        a, b = getattr(first, name), getattr(second, name)
        if np.asarray(a).dtype.kind == "f":
            np.testing.assert_allclose(a, b, atol=1e-9, rtol=1e-9, err_msg=name)
        else:
            np.testing.assert_array_equal(a, b, err_msg=name)
