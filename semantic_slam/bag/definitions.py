"""Message types that only a bag knows: built from the definitions embedded in it, apart from our own registry."""

from collections.abc import Mapping
from typing import Any

from rosbags.typesys import get_types_from_idl, get_types_from_msg
from rosbags.typesys.store import Typestore

from semantic_slam.errors import InputError
from semantic_slam.messages.typestore import PACKAGE, typestore

IDL_MARK = "=" * 80 + "\nIDL: "
"""How rosbag2 begins a definition in IDL; any other text is in the form of ``.msg`` files."""


def extended_typestore(definitions: Mapping[str, str]) -> Typestore:
    """Our types and those of ``definitions`` (type name -> text, with the texts of nested types behind separators).

    A type that we know keeps our definition. Raises InputError where a text is no definition, or is another
    definition of one of our own types.
    """
    store = Typestore()
    store.fielddefs.update(typestore().fielddefs)
    store.types.update(typestore().types)
    for type_name, text in definitions.items():
        if type_name not in store.types:
            register(store, type_name, text)
        elif type_name.startswith(f"{PACKAGE}/"):
            _check_ours(type_name, text)
    return store


def register(store: Typestore, type_name: str, text: str) -> None:
    """Add one type, and the nested ones that the store lacks, to ``store``."""
    store.register({name: fields for name, fields in _parsed(type_name, text).items() if name not in store.types})


def _check_ours(type_name: str, text: str) -> None:
    if _parsed(type_name, text)[type_name][1] != typestore().fielddefs[type_name][1]:
        raise InputError(f"{type_name}: recorded with another definition than this version's; record the bag again")


def _parsed(type_name: str, text: str) -> dict[str, Any]:
    try:
        return dict(get_types_from_idl(text) if text.startswith(IDL_MARK) else get_types_from_msg(text, type_name))
    except Exception as fault:  # the parser's own errors are not of one family
        reason = " ".join(str(fault).split())[:200]
        raise InputError(f"{type_name}: its embedded definition is not readable ({reason}); record it anew") from None
