"""Named text vectors written by a user's text encoder: .npz, .safetensors or .json; data only."""

import json
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from semantic_slam.errors import InputError, one_line
from semantic_slam.geometry.arrays import Array

REMEDY = "write name -> vector as .npz (numpy.savez), .safetensors or .json"


def read_text_vectors(path: Path) -> dict[str, Array]:
    """Read the vectors of a file, name -> (F,). Raises InputError."""
    readers = {".npz": _npz, ".safetensors": _safetensors, ".json": _json}
    if path.suffix not in readers:
        raise InputError(f"{path}: a file of named vectors ends in {', '.join(readers)}; {REMEDY}")
    try:
        found = {
            name: np.asarray(value, dtype=np.float64).squeeze() for name, value in readers[path.suffix](path).items()
        }
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; {REMEDY}") from None
    except (OSError, ValueError, TypeError, AttributeError, BadZipFile, EOFError) as fault:
        raise InputError(f"{path}: no named vectors ({one_line(fault, 200)}); {REMEDY}") from None
    for name, vector in found.items():
        if vector.ndim != 1 or not len(vector) or not np.isfinite(vector).all():
            raise InputError(f"{path}: '{name}' is no vector of finite numbers; {REMEDY}")
    if not found or len({len(vector) for vector in found.values()}) > 1:
        raise InputError(f"{path}: holds no vectors, or vectors of different lengths; {REMEDY}")
    return found


def read_vector(path: Path) -> Array:
    """Read a single (F,) vector: .npy, .json (a list), or a file with one named vector. Raises InputError."""
    if path.suffix == ".npy":
        try:
            return np.asarray(np.load(path, allow_pickle=False), dtype=np.float64).squeeze()
        except (OSError, ValueError, TypeError, EOFError) as fault:
            raise InputError(f"{path}: no vector ({one_line(fault, 200)}); write one as .npy") from None
    if path.suffix == ".json" and path.is_file():
        value = _parsed(path)
        if isinstance(value, list):
            return _numbers(value, path)
    named = read_text_vectors(path)
    if len(named) > 1:
        raise InputError(f"{path}: holds {len(named)} vectors; write the one that is looked for as .npy")
    return next(iter(named.values()))


def _npz(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def _safetensors(path: Path) -> dict[str, Any]:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return dict(load(path.read_bytes()))
    except SafetensorError as fault:
        raise ValueError(str(fault)) from None


def _json(path: Path) -> dict[str, Any]:
    value = _parsed(path)
    if not isinstance(value, dict):
        raise ValueError("the document is no object of names")
    return value


def _parsed(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _numbers(value: list[Any], path: Path) -> Array:
    try:
        return np.asarray(value, dtype=np.float64)
    except (ValueError, TypeError):
        raise InputError(f"{path}: no list of numbers; {REMEDY}") from None
