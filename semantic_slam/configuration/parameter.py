"""A field of a configuration: its default, what it means and what bounds it."""

from dataclasses import field
from typing import Any


def parameter(default: Any, text: str, **limits: Any) -> Any:
    """A dataclass field with its description; ``minimum``, ``maximum``, ``choices`` or ``lengths`` bound its value.

    Numbers are finite; with ``infinite=True`` they may also be .inf, for lengths and thresholds of which that is a
    sensible limit. ``distinct=True``: a list of alternatives, none of which may be in it twice. ``formerly``: an older
    name under which files may still have it.
    """
    metadata = {"description": text, **limits}
    if isinstance(default, tuple):
        return field(default_factory=lambda: default, metadata=metadata)
    return field(default=default, metadata=metadata)
