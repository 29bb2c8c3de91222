"""Texts, YAML and JSON of files that others wrote: whatever is wrong with one is a line, and costs no more."""

import json
from pathlib import Path
from typing import Any

import yaml

from semantic_slam.errors import InputError

LONGEST = 64 << 20
"""Bytes; no configuration, label file or map of ours comes near."""


def read_text(path: Path, remedy: str) -> str:
    """The text of a file in UTF-8; raises InputError that ends in ``remedy``."""
    try:
        if path.stat().st_size > LONGEST:
            raise InputError(f"{path}: larger than {LONGEST >> 20} MiB; {remedy}")
        return path.read_text(encoding="utf-8")
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}; {remedy}") from None
    except UnicodeDecodeError as fault:
        raise InputError(f"{path}: no text in UTF-8 (byte {fault.start}); {remedy}") from None


def parse_yaml(text: str, origin: str, remedy: str) -> Any:
    """What a YAML text holds. Raises InputError, for aliases, too: a few of them make a document of any size."""
    try:
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
            raise InputError(f"{origin}: YAML aliases (*name) are not read; write the values out")
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as fault:
        reason = " ".join(str(fault).split())[:200]
        raise InputError(f"{origin}: not a readable YAML file ({reason}); {remedy}") from None


def parse_json(text: str) -> Any:
    """What a JSON text holds; raises ValueError, for nesting that nobody writes, too."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
