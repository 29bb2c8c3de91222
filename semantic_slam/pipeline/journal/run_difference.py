"""What differs between the runs of two journals, in words."""

import json
from typing import Any

WORDS = {"configuration": "configuration", "map_prior": "map", "source": "input", "version": "version"}
"""Name of each part of a run's identity for users."""
STATED = ("source", "version")
"""Parts that are told as they are."""


def difference(there: str, here: str) -> str:
    """Which parts of a journal's run ``there`` differ from those of the run ``here``, both JSON objects."""
    try:
        theirs, ours = dict(json.loads(there)), dict(json.loads(here))
    except (ValueError, TypeError):
        theirs, ours = {}, {}
    told = [_told(name, theirs.get(name), ours.get(name)) for name in WORDS if theirs.get(name) != ours.get(name)]
    return ", ".join(told) or "its configuration, map, input or version differ"


def _told(name: str, theirs: Any, ours: Any) -> str:
    if name in STATED:
        return f"its {WORDS[name]} is {theirs or 'none'}, not {ours or 'none'}"
    if isinstance(theirs, dict) and isinstance(ours, dict):
        parts = sorted(key for key in theirs.keys() | ours.keys() if theirs.get(key) != ours.get(key))
        return f"its {WORDS[name]} differs in {', '.join(parts)}"
    return f"its {WORDS[name]} differs"
