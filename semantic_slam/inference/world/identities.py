"""Which object of a map an identity means: a track id that comes with a detection, or a true id."""

from collections.abc import Mapping


def objects_by_identity(names: Mapping[int, str]) -> dict[str, int]:
    """Object id by identity, for a map of objects with these ``names`` by id.

    An identity means the object of that name. If there is none, a number means the object with that id, unless names of
    the map are numbers other than the ids of their objects. Those are the numbers of a tracker, and an id beside them
    only tells in which order a run met its objects. There, numbers still mean objects without a name of their own.
    """
    is_numbered_by_tracker = any(name.isdecimal() and name != str(number) for number, name in names.items())
    with_number = [n for n, name in names.items() if not is_numbered_by_tracker or not has_own_name(n, name)]
    return {str(n): n for n in with_number} | {name: n for n, name in names.items()}


def has_own_name(object_id: int, name: str) -> bool:
    """Whether an object has another name than its number, or what it is called where no name was given."""
    return name not in ("", str(object_id), default_name(object_id))


def default_name(object_id: int) -> str:
    """Name of a mapped object that was given none."""
    return f"object_{object_id}"
