"""Calibrated configuration file: values that differ from the defaults, with comments on calibrated ones."""

import math
from collections.abc import Mapping
from typing import Any

import yaml

from semantic_slam.calibration.calibrate import Calibration
from semantic_slam.calibration.search import Change
from semantic_slam.configuration import Configuration, to_dict

INDENT = "  "
HEADER = """\
# Calibrated by the evidence of {bag} ({keyframes} keyframes): {gain} nats more than under {base}.
# No ground truth was used. Values with a comment were changed, the others are those of {base}.
/**:
  ros__parameters:
"""


def configuration_text(found: Calibration, base: str) -> str:
    """Text of ``calibrated.yaml``; ``base`` is the name of the initial configuration."""
    header = HEADER.format(
        bag=found.drive.bag.name, keyframes=found.first.num_keyframes, gain=f"{found.gain:+.1f}", base=base
    )
    values = differing(to_dict(found.after), to_dict(Configuration()))
    for name in found.changes:  # also list parameters that were changed to their default
        _put(values, name, to_dict(found.after))
    return header + "\n".join(_lines(values, found.changes, "", 2 * INDENT)) + "\n"


def differing(values: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Values that differ from ``defaults``, section by section."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        own = differing(value, defaults[name]) if isinstance(value, dict) else value
        if own != defaults[name] and own != {}:
            found[name] = own
    return found


def _put(values: dict[str, Any], name: str, whole: Mapping[str, Any]) -> None:
    *sections, last = name.split(".")
    for section in sections:
        values, whole = values.setdefault(section, {}), whole[section]
    values[last] = whole[last]


def _lines(values: Mapping[str, Any], changes: Mapping[str, Change], prefix: str, indent: str) -> list[str]:
    lines = []
    for name, value in values.items():
        if isinstance(value, dict):
            lines += [f"{indent}{name}:", *_lines(value, changes, f"{prefix}{name}.", indent + INDENT)]
        else:
            lines.append(f"{indent}{name}: {text_of(value)}{_comment(changes.get(prefix + name))}")
    return lines


def text_of(value: Any) -> str:
    """YAML form of a value on one line."""
    plain = list(value) if isinstance(value, tuple) else value
    return str(yaml.safe_dump([plain], default_flow_style=True, width=math.inf)).strip()[1:-1]


def _comment(change: Change | None) -> str:
    if change is None:
        return ""
    return f"  # from {text_of(change.before)}: {change.gain:+.1f} nats with {change.quantity}"
