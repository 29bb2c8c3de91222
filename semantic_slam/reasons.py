"""Counts, by reason, of what is not used: bounded in number and length, whatever names others put into the reasons."""

from collections import Counter

LONGEST_NAME = 80
"""Characters of a foreign name, such as a frame id or a label, that are quoted in a reason."""
LONGEST_REASON = 400
MOST_REASONS = 100
"""Reasons of a counter beyond which those with foreign names are counted together, as ``OTHER``."""
OTHER = "other reasons"


def quoted(name: str) -> str:
    """A foreign name in quotes, at most its first ``LONGEST_NAME`` characters."""
    return f"'{name[:LONGEST_NAME]}'"


def bounded(counts: Counter[str], reason: str) -> str:
    """The key under which a reason is counted: its first ``LONGEST_REASON`` characters, or ``OTHER``."""
    shortened = reason[:LONGEST_REASON]
    return shortened if shortened in counts or len(counts) < MOST_REASONS else OTHER


def count(counts: Counter[str], reason: str) -> None:
    """Count once more a reason that names what others have sent, such as a frame id, a label or a size."""
    counts[bounded(counts, reason)] += 1
