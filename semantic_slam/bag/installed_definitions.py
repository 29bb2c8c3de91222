"""Message definitions of installed ROS packages, for bags that hold none: sqlite3 recordings before ROS 2 Iron."""

import os
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

Definitions = dict[str, Any]


def register_installed(store: Typestore, type_name: str) -> bool:
    """Add a type, with the nested ones that the store lacks, from AMENT_PREFIX_PATH; False where one is not installed.

    The bag does not say by which definition it was recorded: the installed one is taken for it.
    """
    found: Definitions = {}
    waiting = {type_name}
    while waiting:
        name = waiting.pop()
        parsed = _installed(name, os.environ.get("AMENT_PREFIX_PATH", ""))
        if name not in parsed:
            return False
        found |= {name: parsed[name]}
        waiting |= {kind for _, field in parsed[name][1] for kind in _nested(field)} - {*found, *store.types}
    store.register(found)
    return True


@cache
def _installed(type_name: str, prefixes: str) -> Definitions:
    """Parsed definition of one type in the first of the ``prefixes`` that has it; {}: none has a readable one."""
    package, _, name = type_name.partition("/msg/")
    if not (package.isidentifier() and name.isidentifier()):
        return {}
    for prefix in filter(None, prefixes.split(os.pathsep)):
        path = Path(prefix) / "share" / package / "msg" / f"{name}.msg"
        if path.is_file():
            try:
                return dict(get_types_from_msg(path.read_text(encoding="utf-8"), type_name))
            except Exception:  # the parser's exceptions have no common base class
                return {}
    return {}


def _nested(field: Any) -> set[str]:
    """Type names of messages in a field, a pair of node type and its details."""
    node, detail = field
    if node == Nodetype.NAME:
        return {str(detail)}
    return set() if node == Nodetype.BASE else _nested(detail[0])
