"""docs/messages.md, from the definitions in msg_defs."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from semantic_slam_lab.documentation.writing.markdown import table

INTRODUCTION = """# Messages

The package `semantic_slam_msgs` (folder `msg_defs`). Arrays are flat and row-major: `D x 4` is `4 D` numbers, one row
for each of `D` things. A field that the configured model does not fill is NaN or empty. Metres, radians, nats; poses
are `x y z qx qy qz qw`; covariances are over `x y z rx ry rz` as in `geometry_msgs/PoseWithCovariance`.

Read [HybridBelief](#hybridbelief) first.
"""
FIRST = ("HybridBelief", "DetectionArray", "SemanticMeasurementArray")
"""What a user reads and writes; the others are what the nodes say to each other."""
LINE = re.compile(r"^(?P<type>[\w/\[\]<>=]+)\s+(?P<name>\w+)\s*(?:#\s*(?P<text>.*))?$")


@dataclass
class Definition:
    """One message or service: its leading comment and its fields; several parts only in a service."""

    name: str
    text: str = ""
    parts: list[list[list[str]]] = field(default_factory=lambda: [[]])  # part -> field -> [type, name, text]


def messages_page(folder: Path) -> str:
    """Markdown of all definitions below ``folder``/msg and ``folder``/srv."""
    messages = [read_definition(path) for path in sorted((folder / "msg").glob("*.msg"))]
    messages.sort(key=lambda each: (FIRST.index(each.name) if each.name in FIRST else len(FIRST), each.name))
    services = [read_definition(path) for path in sorted((folder / "srv").glob("*.srv"))]
    return "\n".join([INTRODUCTION, *(_section(each) for each in (*messages, *services))])


def read_definition(path: Path) -> Definition:
    """Fields with their comments; a comment that continues on the next line belongs to the field above."""
    found = Definition(path.stem)
    for line in path.read_text(encoding="utf-8").splitlines():
        _take(found, line.strip())
    return found


def _take(found: Definition, line: str) -> None:
    fields = found.parts[-1]
    if line == "---":
        found.parts.append([])
    elif line.startswith("#"):
        words = line.lstrip("# ")
        if fields:
            fields[-1][2] = f"{fields[-1][2]} {words}"
        else:
            found.text = f"{found.text} {words}".strip()
    elif matched := LINE.match(line):
        fields.append([matched["type"], matched["name"], matched["text"] or ""])


def _section(found: Definition) -> str:
    titles = ("request", "answer") if len(found.parts) > 1 else ("",)
    text = [f"## {found.name}", "", found.text, ""]
    for title, fields in zip(titles, found.parts, strict=True):
        if title:
            text += [f"{title.capitalize()}:", ""]
        text.append(table(("field", "type", "meaning"), [(f"`{n}`", f"`{t}`", words) for t, n, words in fields]))
    return "\n".join(text)
