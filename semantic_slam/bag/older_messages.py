"""Migration of messages of our own types recorded by an older version to the current definition.

A field missing in the older definition gets the value for "not given": NaN, or an empty array, string or message.
"""

from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from semantic_slam.bag.definitions import FORMER_NAMES, is_ours
from semantic_slam.messages.typestore import message_class, serialize, typestore


def current_bytes(cdr: bytes, type_name: str, recorded: Typestore) -> bytes:
    """Re-encode a message from the definition in ``recorded`` to our definition."""
    return serialize(_current(recorded.deserialize_cdr(cdr, type_name), type_name))


def _current(message: Any, type_name: str) -> Any:
    """Convert a message, and nested messages of ours, to our current classes."""
    former = {now: then for then, now in FORMER_NAMES.get(type_name, {}).items()}
    values = {}
    for name, kind in typestore().fielddefs[type_name][1]:
        found = getattr(message, name, getattr(message, former.get(name, name), None))
        values[name] = not_given(kind) if found is None else _of_our_class(found, kind)
    return message_class(type_name)(**values)


def _of_our_class(value: Any, kind: Any) -> Any:
    node, detail = kind
    return _current(value, detail) if node == Nodetype.NAME and is_ours(detail) else value


def not_given(kind: Any) -> Any:
    """Value that represents "not given" for a field of this kind."""
    node, detail = kind
    if node == Nodetype.BASE:
        return _no_value(detail[0])
    if node == Nodetype.NAME:
        fields = typestore().fielddefs[detail][1]
        return message_class(detail)(**{name: not_given(own) for name, own in fields})
    (element, own), size = detail
    count = size if node == Nodetype.ARRAY else 0
    if element == Nodetype.NAME or own[0] == "string":
        return [not_given((element, own)) for _ in range(count)]
    return np.full(count, _no_value(own[0]), dtype=own[0])


def _no_value(element: str) -> Any:
    if element.startswith("float"):
        return np.nan
    return {"string": "", "bool": False}.get(element, 0)
