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


def parse_yaml(text: str, origin: str, remedy: str) -> Any:
    """Parse YAML. Raises InputError, also for aliases: a few of them can expand to a document of any size."""
    try:
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
            raise InputError(f"{origin}: YAML aliases (*name) are not read; write the values out")
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as fault:
        reason = one_line(fault, 200)
        raise InputError(f"{origin}: not a readable YAML file ({reason}); {remedy}") from None


def parse_json(text: str) -> Any:
    """Parse JSON. Raises ValueError, also for excessive nesting."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
