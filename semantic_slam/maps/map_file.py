"""``FILE.map``: a saved map in one file of arrays and a JSON description; no code is executed.

The map id is the digest of the content, which reveals later modification. Every reader also accepts the previous
version, without class priors, and the one before that, ``objects.json``.
"""

import hashlib
import json
import os
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.configuration.configuration import STATE_SPACES
from semantic_slam.errors import InputError, one_line
from semantic_slam.inference.world import map_prior
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.maps.as_prior import map_prior_of, saved_map_of_prior
from semantic_slam.maps.checks import MOST_OBJECTS, check_map
from semantic_slam.maps.saved_map import MapHypotheses, MapObjects, Provenance, SavedMap, ViewedFrom
from semantic_slam.model_files import Arrays, ModelFormat

REMEDY = "save it anew with semantic_slam map save"
FORMAT = ModelFormat(kind="map", schema_version=2, remedy=REMEDY, older=(1,))
LARGEST = 1 << 27
"""Largest file size read, in bytes."""
LONGEST_NAME = 1000
"""Largest number of characters in the name of a class or an object."""
PRIORS = "objects.class_priors"
"""Array that is missing in schema 1."""


def write_map(path: Path, saved: SavedMap) -> SavedMap:
    """Write a map atomically; returns it with its id. The caller must have claimed the path. Raises InputError."""
    _check_names(path, saved)
    try:
        check_map(saved)
    except ValueError as fault:
        raise InputError(
            f"{path}: not written ({fault}); map fewer objects, or report the run that gave this map"
        ) from None
    known = with_id(saved)
    beside = path.with_name(f".{path.name}.unfinished")
    try:
        FORMAT.write(beside, *packed(known))
        os.replace(beside, path)
    except OSError as fault:
        raise InputError(f"{path}: cannot be written ({fault.strerror}); name another place") from None
    finally:
        beside.unlink(missing_ok=True)
    return known


def _check_names(path: Path, saved: SavedMap) -> None:
    """Raise InputError where a class or an object has a name that no reader would take."""
    for name in (*saved.class_names, *saved.objects.names):
        if len(name) > LONGEST_NAME:
            raise InputError(
                f"{path}: not written, the name {name[:40]!r}... has {len(name)} characters and a map takes"
                f" {LONGEST_NAME}; shorten it, a label with import_dataset bag --labels"
            )


def packed(saved: SavedMap) -> tuple[Arrays, dict[str, Any]]:
    """Arrays and description of a map as stored in its file."""
    return _arrays(saved), _description(saved) | {"map_id": saved.map_id}


def with_id(saved: SavedMap) -> SavedMap:
    """The map with its id set to the digest of its content."""
    state = hashlib.blake2b(json.dumps(_description(saved), sort_keys=True).encode(), digest_size=8)
    arrays = _arrays(saved)
    if np.isnan(saved.objects.class_priors).all():
        del arrays[PRIORS]  # a map of schema 1 keeps its id
    for name, values in sorted(arrays.items()):
        state.update(f"{name}{values.dtype.str}{values.shape}".encode())
        state.update(values.tobytes())
    return replace(saved, map_id=state.hexdigest())


def read_map(path: str | Path) -> SavedMap:
    """Read a map from a ``FILE.map`` or an ``objects.json``. Raises InputError."""
    path = Path(path)
    if not is_map_file(path):
        known = map_prior.read_map_prior(path)
        if len(known.objects) > MOST_OBJECTS:
            raise InputError(f"{path}: {len(known.objects)} objects, a map has {MOST_OBJECTS} at most; leave some out")
        return with_id(saved_map_of_prior(known))
    if path.stat().st_size > LARGEST:
        raise InputError(f"{path}: larger than {LARGEST >> 20} MiB; {REMEDY}")
    try:
        arrays, description = FORMAT.read(path)
        found = _saved(_migrated(arrays, description), description)
        check_map(found)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as fault:
        reason = one_line(fault, 200)
        raise InputError(f"{path}: no whole map ({reason}); {REMEDY}") from None
    if with_id(found).map_id != description.get("map_id"):
        raise InputError(f"{path}: its content is not what its id says, it was damaged or changed; {REMEDY}")
    return with_id(found)


def read_map_prior(path: str | Path) -> MapPrior:
    """Read a run's map prior from a ``FILE.map`` or an ``objects.json``. Raises InputError."""
    path = Path(path)
    return map_prior_of(read_map(path)) if is_map_file(path) else map_prior.read_map_prior(path)


def is_map_file(path: Path) -> bool:
    """Whether a file is a ``FILE.map`` rather than text. Raises InputError where it cannot be read.

    Pipes and devices are not opened: reading them may block for ever, or never end.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise InputError(f"{path}: is no file; name an existing FILE.map or objects.json")
        with path.open("rb") as file:
            return b"\0" in file.read(16)
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}; name an existing FILE.map or objects.json") from None


def _arrays(saved: SavedMap) -> Arrays:
    parts: dict[str, Any] = {"objects": saved.objects, "hypotheses": saved.hypotheses, "looks": saved.looks}
    named = {f"{part}.{own.name}": getattr(value, own.name) for part, value in parts.items() for own in fields(value)}
    kinds = {"objects.ids": np.int64}
    return {
        name: np.array(values, dtype=kinds.get(name, np.float64), order="C")
        for name, values in named.items()
        if name != "objects.names"
    }


def _description(saved: SavedMap) -> dict[str, Any]:
    return {
        "frame": "map",
        "state_space": saved.state_space,
        "names": list(saved.objects.names),
        "class_names": list(saved.class_names),
        "has_cross_covariances": saved.has_cross_covariances,
        "discarded_mass": saved.discarded_mass,
        "descriptor_space": saved.descriptor_space,
        "provenance": _described(saved.provenance),
    }


def _described(provenance: Provenance) -> dict[str, Any]:
    """Provenance as written; ancestors and start only where they are known, so that maps of before keep their ids."""
    entries = asdict(provenance)
    later = {"ancestors": list(entries.pop("ancestors")), "began_ns": entries.pop("began_ns")}
    return entries | {name: value for name, value in later.items() if value}


def _saved(arrays: Arrays, entries: dict[str, Any]) -> SavedMap:
    """Parse arrays and description. Raises KeyError, TypeError or ValueError."""
    if entries["frame"] != "map" or entries["state_space"] not in STATE_SPACES:
        raise ValueError(f"frame {entries['frame']!r}, state space {entries['state_space']!r}")
    parts: dict[str, type[Any]] = {"objects": MapObjects, "hypotheses": MapHypotheses, "looks": ViewedFrom}
    expected = {f"{part}.{own.name}" for part, kind in parts.items() for own in fields(kind)} - {"objects.names"}
    if set(arrays) != expected:
        raise ValueError(f"arrays are lacking or strange: {sorted(set(arrays) ^ expected)[0]}")
    for name, values in arrays.items():
        if values.dtype != (np.int64 if name == "objects.ids" else np.float64):
            raise ValueError(f"{name} holds {values.dtype}")
    part_arrays = {part: _of(part, arrays) for part in parts}
    return SavedMap(
        class_names=_texts(entries["class_names"]),
        objects=MapObjects(names=_texts(entries["names"]), **part_arrays["objects"]),
        hypotheses=MapHypotheses(**part_arrays["hypotheses"]),
        looks=ViewedFrom(**part_arrays["looks"]),
        has_cross_covariances=_flag(entries["has_cross_covariances"]),
        discarded_mass=float(entries["discarded_mass"]),
        descriptor_space=str(entries["descriptor_space"]),
        state_space=entries["state_space"],
        provenance=_provenance(entries["provenance"]),
    )


def _migrated(arrays: Arrays, entries: dict[str, Any]) -> Arrays:
    """Convert arrays of the previous schema, which lacks class priors, to this one. Raises KeyError."""
    if entries["schema_version"] == 1:
        return {PRIORS: np.full_like(arrays["objects.class_probabilities"], np.nan)} | arrays
    return arrays


def _of(part: str, arrays: Arrays) -> dict[str, Any]:
    return {name.partition(".")[2]: values for name, values in arrays.items() if name.startswith(f"{part}.")}


def _provenance(entries: dict[str, Any]) -> Provenance:
    """Parse a provenance; files of before name no ancestors and no start. Raises TypeError or ValueError."""
    whole: dict[str, Any] = {"ancestors": [], "began_ns": 0} | entries
    whole["ancestors"] = _texts(whole["ancestors"])
    kinds = {own.name: type(own.default) for own in fields(Provenance)}
    if set(whole) != set(kinds) or any(type(whole[name]) is not kind for name, kind in kinds.items()):
        raise ValueError("its provenance is not whole")
    return Provenance(**whole)


def _texts(values: Any) -> tuple[str, ...]:
    if not isinstance(values, list) or not all(isinstance(own, str) and len(own) <= LONGEST_NAME for own in values):
        raise ValueError(f"names are texts of at most {LONGEST_NAME} characters")
    return tuple(values)


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError("has_cross_covariances is true or false")
    return value
