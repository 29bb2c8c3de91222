"""Safe reading of foreign text, YAML and JSON: any fault is a one-line error, and cost is bounded."""

import json
from pathlib import Path
from typing import Any

import yaml

from semantic_slam.errors import InputError, one_line

LONGEST = 64 << 20
"""Size limit in bytes, far above any configuration, label file or map written here."""


def read_text(path: Path, remedy: str) -> str:
    """Text of a UTF-8 file. Raises InputError, whose message ends in ``remedy``."""
    try:
        if path.stat().st_size > LONGEST:
            raise InputError(f"{path}: larger than {LONGEST >> 20} MiB; {remedy}")
        return path.read_text(encoding="utf-8")
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}; {remedy}") from None
    except UnicodeDecodeError as fault:
        raise InputError(f"{path}: no text in UTF-8 (byte {fault.start}); {remedy}") from None


def parse_yaml(text: str, origin: str, remedy: str, kind: type[yaml.SafeLoader] = yaml.SafeLoader) -> Any:
    """Parse YAML. Raises InputError, also for a key that a mapping has twice, and for aliases.

    A few aliases can expand to a document of any size. A loader of another ``kind`` may read values otherwise.
    """
    try:
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
            raise InputError(f"{origin}: YAML aliases (*name) are not read; write the values out")
        loader = kind(text)
        document = loader.get_single_node()
        _check_keys(document)
        return None if document is None else loader.construct_document(document)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as fault:
        reason = one_line(fault, 200)
        raise InputError(f"{origin}: not a readable YAML file ({reason}); {remedy}") from None


def _check_keys(document: Any) -> None:
    """Raise YAMLError for a key that a mapping has twice: a loader would keep its last value, in silence."""
    nodes = [document]
    while nodes:
        node = nodes.pop()
        if isinstance(node, yaml.SequenceNode):
            nodes += node.value
        elif isinstance(node, yaml.MappingNode):
            first: dict[tuple[str, str], Any] = {}
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                other = first.setdefault((key.tag, key.value), key)
                if other is not key:
                    lines = [place.start_mark.line + 1 for place in (other, key)]
                    raise yaml.YAMLError(f"'{key.value[:80]}' in line {lines[0]} and again in line {lines[1]}")
            nodes += [value for _, value in node.value]


def parse_json(text: str) -> Any:
    """Parse JSON. Raises ValueError, also for excessive nesting."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
