"""Message types as a bag defines them: those that only the bag knows, and ours as an older version recorded them."""

from collections.abc import Mapping
from typing import Any

from rosbags.typesys import get_types_from_idl, get_types_from_msg
from rosbags.typesys.store import Typestore

from semantic_slam.errors import InputError
from semantic_slam.messages.typestore import PACKAGE, typestore

IDL_MARK = "=" * 80 + "\nIDL: "
"""How rosbag2 begins a definition in IDL; any other text is in the form of ``.msg`` files."""
FORMER_NAMES = {f"{PACKAGE}/msg/Components": {"descriptor_variances": "descriptor_covariances"}}
"""Fields that older versions called otherwise, by type: their name then -> their name now."""


def is_ours(type_name: str) -> bool:
    """Whether a type is one of this project's messages."""
    return type_name.startswith(f"{PACKAGE}/")


def extended_typestore(definitions: Mapping[str, str]) -> Typestore:
    """Our types and those of ``definitions`` (type name -> text, with the texts of nested types behind separators).

    A type that we know keeps our definition. Raises InputError where a text is no definition, or defines one of our
    own types with a field that this version does not know.
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


def older_typestore(type_name: str, text: str) -> Typestore | None:
    """A store in which one of our types, and the nested ones, are as ``text`` defines them; None: as we define them.

    Raises InputError where that definition has a field that ours lacks, or has with another type.
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
    """Raises InputError when a field of a recorded definition is not one of ours, under its name now."""
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
    except Exception as fault:  # the parser's own errors are not of one family
        name, reason = (" ".join(str(told).split())[:200] for told in (type_name, fault))
        raise InputError(f"{name}: its embedded definition is not readable ({reason}); record it anew") from None
