"""What a photograph's path says of it, by a pattern such as ``{object}__{azimuth}.jpg``: text and fields, no code."""

import re
from dataclasses import dataclass

from semantic_slam.errors import InputError

NUMBER = r"[-+]?\d+(?:\.\d+)?"
FIELDS = {"object": r"[^/]+?", "azimuth": NUMBER, "clockwise": NUMBER, "elevation": NUMBER, "polar": NUMBER}
"""Field -> what it stands for. Degrees all: azimuth counter-clockwise as seen from above, or ``clockwise``; elevation
above the table, or ``polar`` from straight above."""
PLACEHOLDER = re.compile(r"\{([^{}]*)\}")


@dataclass(frozen=True)
class Named:
    """What a path says: whose view it is, and from where."""

    object_name: str
    azimuth_deg: float  # [0, 360) of the camera about the object, counter-clockwise from above
    elevation_deg: float  # of the camera above the table


class PathPattern:
    """Paths relative to a folder, with ``FIELDS`` in braces; a field that stands twice has to say the same twice."""

    def __init__(self, text: str) -> None:
        """Raises InputError for a field that there is not, or a pattern without object or azimuth."""
        self.text = text
        self.fields = tuple(dict.fromkeys(PLACEHOLDER.findall(text)))
        for name in self.fields:
            if name not in FIELDS:
                raise InputError(f"pattern '{text}': no field {{{name}}}; there are {', '.join(FIELDS)}")
        missing = [] if "object" in self.fields else ["object"]
        if not {"azimuth", "clockwise"} & set(self.fields):
            missing.append("azimuth")
        if missing:
            raise InputError(f"pattern '{text}': needs {{{missing[0]}}}; such as {{object}}__{{azimuth}}.jpg")
        self._expression = re.compile(_expression(text))

    def read(self, path: str) -> Named | None:
        """What a path with forward slashes says; None where it is no such path."""
        match = self._expression.fullmatch(path)
        if match is None:
            return None
        found = match.groupdict()
        azimuth = float(found["azimuth"]) if "azimuth" in found else -float(found["clockwise"])
        elevation = 90.0 - float(found["polar"]) if "polar" in found else float(found.get("elevation", 0.0))
        return Named(found["object"], azimuth % 360.0, elevation)

    def fill(self, pattern: str, path: str) -> str:
        """Another path of the same view: ``pattern`` with the words that stand in ``path``. Raises InputError."""
        match = self._expression.fullmatch(path)
        words = match.groupdict() if match else {}
        unknown = [name for name in PLACEHOLDER.findall(pattern) if name not in words]
        if unknown:
            raise InputError(f"pattern '{pattern}': {{{unknown[0]}}} is no field of '{self.text}'; use its fields")
        return PLACEHOLDER.sub(lambda found: words[found[1]], pattern)


def _expression(text: str) -> str:
    """Regular expression of a pattern: text as it is, the first of each field a group, others what that one said."""
    parts, seen, end = [], set(), 0
    for found in PLACEHOLDER.finditer(text):
        name = found[1]
        parts.append(re.escape(text[end : found.start()]))
        parts.append(f"(?P={name})" if name in seen else f"(?P<{name}>{FIELDS[name]})")
        seen.add(name)
        end = found.end()
    return "".join(parts) + re.escape(text[end:])
