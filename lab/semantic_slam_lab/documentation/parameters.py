"""docs/parameters.md and config/default.yaml, from the dataclasses of the configuration."""

import dataclasses
import json
from typing import Any

from semantic_slam.configuration import Configuration
from semantic_slam.registry import Registry
from semantic_slam_lab.documentation.writing.markdown import table

INTRODUCTION = """# Parameters

Every parameter of a run. A name with a dot is a ROS parameter (`-p pruning.ratio:=100.0`) and a key of a YAML file,
plain or in the form of a ROS 2 parameter file:

```yaml
/**:
  ros__parameters:
    association: open
    pruning: {ratio: 100.0}                # or pruning.ratio: 100.0
```

`semantic_slam report --config FILE`, `semantic_slam demo --config FILE` and the nodes' `--params-file FILE` read the
same file; what is left out keeps its default, an unknown key is refused by name. Commands, unlike nodes, read only
what stands below `/**`; they refuse a file that addresses nodes by name. The effective configuration is latched on
`/hypothesis_manager/run_configuration` and saved with every result. `config/default.yaml` is a file to start from.
Parameters of single nodes (`compressed`, `backends`, …) are on the page about [ROS](ros.md).
"""

FILE = """# Every parameter of semantic_slam with its default: a ROS 2 parameter file, and --config of the commands.
# Metres, radians, seconds, nats. Copy it, keep what you change. Written by `make docs`.
/**:
  ros__parameters:
"""


def default_file() -> str:
    """YAML of all parameters with their defaults, in the order of the page, each with what it means."""
    alone, groups = _fields()
    lines = [f"    {_line(item, default)}" for item, default in alone]
    for name, group in groups:
        lines += [f"    {name}:", *(f"      {_line(item, default)}" for item, default in _leaves(group))]
    return FILE + "\n".join(lines) + "\n"


def _line(item: Any, default: Any) -> str:
    choices = item.metadata.get("choices", ())
    names = choices.own_names if isinstance(choices, Registry) else choices
    among = f" ({' | '.join(names)})" if names else ""
    return f"{item.name}: {_shown(default)}  # {item.metadata['description']}{among}"


def parameters_page() -> str:
    """Markdown of all parameters: first those without a group, then a section for each group."""
    alone, groups = _fields()
    sections = [f"## {name}\n\n{_table(f'{name}.', _leaves(group))}" for name, group in groups]
    return "\n".join([INTRODUCTION, _table("", alone), *sections])


def _fields() -> tuple[list[tuple[Any, Any]], list[tuple[str, Any]]]:
    """Parameters without a group, and groups by name."""
    fields = dataclasses.fields(Configuration)
    alone = [(item, _default(item)) for item in fields if not dataclasses.is_dataclass(_default(item))]
    return alone, [(item.name, _default(item)) for item in fields if dataclasses.is_dataclass(_default(item))]


def _leaves(group: Any) -> list[tuple[Any, Any]]:
    return [(item, _default(item)) for item in dataclasses.fields(group)]


def _table(prefix: str, leaves: list[tuple[Any, Any]]) -> str:
    rows = [
        (f"`{prefix}{item.name}`", f"`{_shown(default)}`", _limits(item.metadata), item.metadata["description"])
        for item, default in leaves
    ]
    return table(("parameter", "default", "limits", "meaning"), rows)


def _default(item: Any) -> Any:
    return item.default if item.default is not dataclasses.MISSING else item.default_factory()


def _shown(default: Any) -> str:
    """The default as YAML takes it."""
    return json.dumps(list(default) if isinstance(default, tuple) else default)


def _limits(metadata: Any) -> str:
    choices = metadata.get("choices", ())
    if isinstance(choices, Registry):
        return ", ".join(f"`{choice}`" for choice in choices.own_names) + ", [or yours](extending.md)"
    if choices:
        return ", ".join(f"`{choice}`" for choice in choices)
    if "lengths" in metadata:
        return " or ".join(str(length) for length in metadata["lengths"]) + " numbers"
    low, high = metadata.get("minimum"), metadata.get("maximum")
    if high is None:
        return "" if low is None else f"≥ {low:g}"
    return f"{low:g} … {high:g}" if low is not None else f"≤ {high:g}"
