"""Model files: arrays and a JSON description in one safetensors file; loading executes no code from it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from semantic_slam.errors import InputError, one_line

METADATA_KEY = "semantic_slam"

Arrays = dict[str, NDArray[Any]]


def kind_of(path: Path) -> str:
    """Kind of model that a file states; "" where it is no file of models, which reading it then reports."""
    try:
        with safe_open(str(path), framework="np") as file:
            return str(dict(json.loads((file.metadata() or {}).get(METADATA_KEY, ""))).get("kind", ""))
    except (OSError, SafetensorError, ValueError, TypeError):
        return ""


@dataclass(frozen=True, kw_only=True)
class ModelFormat:
    """File format of one kind of model, and the remedy that tells a user how to get such a file."""

    kind: str
    schema_version: int
    remedy: str  # "make one with ..."
    older: tuple[int, ...] = ()  # older schema versions that can still be read; the description names the version

    def write(self, path: Path, arrays: Mapping[str, NDArray[Any]], description: Mapping[str, Any]) -> None:
        """Write contiguous arrays with their description, under the permissions that new files have. Raises OSError.

        What ``safetensors`` writes by itself only its user may read.
        """
        told = {"schema_version": self.schema_version, "kind": self.kind, **description}
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(save(dict(arrays), {METADATA_KEY: json.dumps(told, sort_keys=True)}))

    def read(self, path: Path) -> tuple[Arrays, dict[str, Any]]:
        """Arrays and description of a file. Raises InputError naming the file, the fault and the remedy."""
        try:
            with safe_open(str(path), framework="np") as file:
                arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
                text = (file.metadata() or {}).get(METADATA_KEY, "")
        except (OSError, SafetensorError) as fault:
            reason = one_line(fault)
            raise InputError(f"{path}: not readable as safetensors ({reason}); {self.remedy}") from None
        try:
            description = dict(json.loads(text))
        except (ValueError, TypeError):
            raise InputError(f"{path}: not a file of models; {self.remedy}") from None
        version, kind = description.get("schema_version"), description.get("kind")
        if version not in (self.schema_version, *self.older) or kind != self.kind:
            raise InputError(
                f"{path}: holds kind '{kind}' of schema {version}, wanted is '{self.kind}' of schema"
                f" {self.schema_version}; {self.remedy}"
            )
        return arrays, description
