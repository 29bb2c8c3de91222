"""A field of a configuration: its default, what it means and what bounds it."""

from dataclasses import field
from typing import Any


def parameter(default: Any, text: str, **limits: Any) -> Any:
    """A dataclass field with its description; ``minimum``, ``maximum``, ``choices`` or ``lengths`` bound its value.

    ``formerly``: an older name under which files may still have it.
    """
    metadata = {"description": text, **limits}
    if isinstance(default, tuple):
        return field(default_factory=lambda: default, metadata=metadata)
    return field(default=default, metadata=metadata)
