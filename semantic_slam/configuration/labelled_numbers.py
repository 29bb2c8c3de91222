"""Numbers by a detector's labels, as parameters have them: LABEL=NUMBER."""

from collections.abc import Callable, Sequence

import numpy as np

from semantic_slam.configuration.checked_value import first_repeated
from semantic_slam.errors import InputError


def labelled_numbers(
    name: str, entries: Sequence[str], expected: str, is_valid: Callable[[float], bool]
) -> dict[str, float]:
    """Label, in lower case, -> number, of the ``entries`` of the parameter ``name``.

    Raises InputError for one that is not as ``expected``, or whose number is not valid, and for a label that is there
    twice.
    """
    pairs = [_entry(name, text, expected, is_valid) for text in entries]
    if (again := first_repeated([label for label, _ in pairs])) is not None:
        raise InputError(f"{name}: label {again!r} is there twice, whatever the case; leave one out")
    return dict(pairs)


def _entry(name: str, text: str, expected: str, is_valid: Callable[[float], bool]) -> tuple[str, float]:
    label, _, number = text.rpartition("=")
    try:
        value = float(number)
    except ValueError:
        value = np.nan
    if not label.strip() or not is_valid(value):
        raise InputError(f"{name}: {text!r} is not {expected}; correct it")
    return label.strip().lower(), value
