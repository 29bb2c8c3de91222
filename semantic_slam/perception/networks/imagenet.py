"""ImageNet classes by name: which of a network's 1000 outputs are reported, singly or in groups."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception.class_names import NONE_OF_THESE
from semantic_slam.perception.networks.weight_files import shipped_file
from semantic_slam.text_files import parse_yaml, read_text

NUM_CLASSES = 1000
NAMES_FILE = "imagenet_classes.txt"
GROUPS_REMEDY = "list 'group: [ImageNet class, ...]', see config/imagenet_groups_example.yaml"


def reported_classes(settings: PerceptionConfiguration) -> tuple[tuple[str, ...], tuple[tuple[int, ...], ...]]:
    """Names of the reported classes and the outputs that each sums; the last class sums all other outputs.

    Groups come first, as their file lists them, then single classes. Raises InputError.
    """
    members = _groups(Path(settings.class_groups)) if settings.class_groups else {}
    for name in settings.classes:
        _add(members, name, (output_of(name, "perception.classes"),), "perception.classes")
    if not members:
        raise InputError(
            "perception.classes: none; name ImageNet classes there, or a file of groups in perception.class_groups"
        )
    taken = {output for outputs in members.values() for output in outputs}
    rest = tuple(sorted(set(range(NUM_CLASSES)) - taken))
    return (*members, NONE_OF_THESE), (*members.values(), rest)


def output_of(name: str, origin: str) -> int:
    """Output index of a class, by name or number. Raises InputError, also for a name that is ambiguous."""
    if name.isdecimal():
        if int(name) < NUM_CLASSES:
            return int(name)
        raise InputError(f"{origin}: '{name}' is no number of an ImageNet class; they go up to {NUM_CLASSES - 1}")
    found = _outputs_by_name()[name.strip().casefold()]
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(f"{origin}: '{name}' is a name of several classes; give one by its number: {_listed(found)}")
    near = [output for known, outputs in _outputs_by_name().items() if name.casefold() in known for output in outputs]
    hint = f"; do you mean one of {_listed(near[:8])}?" if near else f"; {NAMES_FILE} of the package lists them"
    raise InputError(f"{origin}: '{name}' is no ImageNet class{hint}")


def class_name(output: int) -> str:
    """First of the class names of an output."""
    return _names()[output][0]


def _groups(path: Path) -> dict[str, tuple[int, ...]]:
    values = parse_yaml(read_text(path, GROUPS_REMEDY), str(path), GROUPS_REMEDY)
    if not isinstance(values, dict) or not values:
        raise InputError(f"{path}: no groups; {GROUPS_REMEDY}")
    members: dict[str, tuple[int, ...]] = {}
    for group, names in values.items():
        if not isinstance(group, str) or not isinstance(names, list) or not names:
            raise InputError(f"{path}: group {group!r} lists no classes; {GROUPS_REMEDY}")
        _add(members, group, tuple(output_of(str(name), str(path)) for name in names), str(path))
    return members


def _add(members: dict[str, tuple[int, ...]], name: str, outputs: tuple[int, ...], origin: str) -> None:
    """Add a class. Raises InputError where the name or an output is used already: every output counts once."""
    taken = {output: other for other, theirs in members.items() for output in theirs}
    twice = [output for output in outputs if output in taken or outputs.count(output) > 1]
    if name in members or name == NONE_OF_THESE or not name.strip():
        raise InputError(f"{origin}: '{name}' names two classes, none, or the rest; choose another name")
    if twice:
        other = taken.get(twice[0], name)
        raise InputError(f"{origin}: '{class_name(twice[0])}' is in '{name}' and in '{other}'; keep one")
    members[name] = outputs


def _listed(outputs: Sequence[int]) -> str:
    return ", ".join(f"{output} ({', '.join(_names()[output][:2])})" for output in outputs)


@cache
def _names() -> tuple[tuple[str, ...], ...]:
    """(1000,) names of every output."""
    lines = read_text(shipped_file(NAMES_FILE), "install the package anew").splitlines()
    return tuple(tuple(line.split(", ")) for line in lines if not line.startswith("#"))


@cache
def _outputs_by_name() -> Mapping[str, list[int]]:
    found: dict[str, list[int]] = defaultdict(list)
    for output, names in enumerate(_names()):
        for name in dict.fromkeys(name.casefold() for name in names):
            found[name].append(output)
    return found
