"""State of long-lived objects: what they learn while they run, beside what they are made of.

A class lists the attributes that hold it in ``STATE``. An object that is made again of the same parameters is, with the
state of another one, as that one was.
"""

from collections import Counter
from typing import Any


def state_of(part: Any) -> Any:
    """State of an object: a dict by attribute, also for the parts that have a state; anything else is returned as is.

    Lists and other containers are not copied: pack the state, or use it up, before the object goes on.
    """
    names = _names(part)
    return part if names is None else {name: state_of(getattr(part, name)) for name in names}


def restore(part: Any, state: dict[str, Any]) -> None:
    """Give an object a state of :func:`state_of`, which is its own from then on. Raises ValueError for another class's.

    Counters keep their identity, as parts count into those of the whole.
    """
    names = _names(part)
    if names is None or state.keys() != set(names):
        raise ValueError(f"no state of {type(part).__name__}")
    for name in names:
        own = getattr(part, name)
        if _names(own) is not None:
            restore(own, state[name])
        elif isinstance(own, Counter):
            own.clear()
            own.update(state[name])
        else:
            setattr(part, name, state[name])


def _names(part: Any) -> tuple[str, ...] | None:
    return getattr(type(part), "STATE", None)
