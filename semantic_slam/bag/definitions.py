"""Message definitions embedded in bags: foreign types, and older definitions of our own types."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from rosbags.typesys import get_types_from_idl, get_types_from_msg
from rosbags.typesys.store import Typestore

from semantic_slam.errors import InputError, one_line
from semantic_slam.messages.typestore import PACKAGE, typestore

IDL_MARK = "=" * 80 + "\nIDL: "
"""Start of an IDL definition in rosbag2; any other text has the form of ``.msg`` files."""
FORMER_NAMES = {f"{PACKAGE}/msg/Components": {"descriptor_variances": "descriptor_covariances"}}
"""Renamed fields by type: old name -> current name."""


def is_ours(type_name: str) -> bool:
    """Whether a type is one of this project's messages."""
    return type_name.startswith(f"{PACKAGE}/")


def extended_typestore(definitions: Mapping[str, str]) -> Typestore:
    """Typestore of our types and those of ``definitions`` (type name -> text with nested types after separators).

    Known types keep our definition. Raises InputError where a text is not a definition, or defines one of our own types
    with a field that is unknown to this version.
    """
    store = Typestore()
    store.fielddefs.update(typestore().fielddefs)
    store.types.update(typestore().types)
    for type_name, text in definitions.items():
        if type_name not in store.types:
            register(store, type_name, text)
        elif is_ours(type_name):
            older_typestore(type_name, text)
    return store


def register(store: Typestore, type_name: str, text: str) -> None:
    """Add one type, and the nested ones that the store lacks, to ``store``."""
    store.register({name: fields for name, fields in _parsed(type_name, text).items() if name not in store.types})


@lru_cache(maxsize=256)
def older_typestore(type_name: str, text: str) -> Typestore | None:
    """Typestore with one of our types, and its nested ones, as defined by ``text``; None where identical to ours.

    Raises InputError where that definition has a field that ours lacks, or has with a different type. Answers are kept:
    every bag that is opened asks for the same few, and parsing takes milliseconds each.
    """
    recorded = {name: fields for name, fields in _parsed(type_name, text).items() if is_ours(name)}
    ours = typestore().fielddefs
    if all(name in ours and fields[1] == ours[name][1] for name, fields in recorded.items()):
        return None
    for name, (_, fields) in recorded.items():
        _check_known(name, fields)
    store = Typestore()
    store.fielddefs.update({name: fields for name, fields in ours.items() if not is_ours(name)})
    store.types.update({name: kind for name, kind in typestore().types.items() if not is_ours(name)})
    store.register(recorded)
    return store


def _check_known(type_name: str, recorded: Any) -> None:
    """Raise InputError when a recorded field is unknown to our definition, after renaming."""
    ours = dict(typestore().fielddefs[type_name][1]) if type_name in typestore().fielddefs else {}
    former = FORMER_NAMES.get(type_name, {})
    for name, kind in recorded:
        if ours.get(former.get(name, name)) != kind:
            raise InputError(
                f"{type_name}: recorded with another definition than this version's (field {name}); read it with the"
                " version that recorded it, or record the bag again"
            )


def _parsed(type_name: str, text: str) -> dict[str, Any]:
    try:
        return dict(get_types_from_idl(text) if text.startswith(IDL_MARK) else get_types_from_msg(text, type_name))
    except Exception as fault:  # the parser's exceptions have no common base class
        name, reason = (one_line(told, 200) for told in (type_name, fault))
        raise InputError(f"{name}: its embedded definition is not readable ({reason}); record it anew") from None
