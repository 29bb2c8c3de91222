"""Whether two dataclasses hold the same values, of the same types, NaN for NaN."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def assert_same(found: Any, expected: Any) -> None:
    assert type(found) is type(expected)
    for item in fields(expected):
        a, b = getattr(found, item.name), getattr(expected, item.name)
        assert type(a) is type(b), item.name
        if is_dataclass(b):
            assert_same(a, b)
        elif isinstance(b, np.ndarray | float):
            assert np.asarray(a).dtype == np.asarray(b).dtype, item.name
            np.testing.assert_array_equal(a, b, err_msg=item.name)
        else:
            assert a == b, item.name
