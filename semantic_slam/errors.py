"""The one error family. Every message names the fault and its remedy in a single line."""

from collections.abc import Sequence

MOST_NAMED = 8
"""Names that a message lists; a network may have a thousand classes."""


class SemanticSlamError(Exception):
    """Anything this package raises on purpose."""


class InputError(SemanticSlamError):
    """Bad input or usage; a command line ends with exit code 2 and this text."""


class MessageError(InputError):
    """A message that cannot be used. A node counts it by ``kind`` and goes on, whoever sent it."""

    def __init__(self, text: str, kind: str = "message cannot be used") -> None:
        super().__init__(text)
        self.kind = kind


def one_line(fault: object, limit: int | None = None) -> str:
    """The text of an exception, often another library's, in a single line of at most ``limit`` characters."""
    return " ".join(str(fault).split())[:limit]


def shortened(names: Sequence[str]) -> str:
    """The first names, separated by commas, and how many there are besides."""
    others = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {others} others" if others > 0 else "")
