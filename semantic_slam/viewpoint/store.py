"""Viewpoint model files: arrays and a JSON description in one safetensors file; loading executes no code from it."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.errors import InputError, one_line
from semantic_slam.model_files import ModelFormat
from semantic_slam.viewpoint.appearance import APPEARANCE_FIELDS, PICTURES, KnownAppearance
from semantic_slam.viewpoint.gaussian_process import GRID, ClassFit, GaussianProcessModel, PosteriorTable
from semantic_slam.viewpoint.spherical_process import AZIMUTHS, ELEVATIONS, SphericalProcessModel, SphericalTable

FORMAT = ModelFormat(
    kind="gp_independent", schema_version=1, remedy="check semantic_model.path, or make one with fit_viewpoint_models"
)
FittedModel = GaussianProcessModel | SphericalProcessModel
"""Class models over azimuth, or over azimuth and elevation."""
APPEARANCE = "appearance."
"""Prefix of the names of arrays that describe the objects' appearance; older files have none."""
NETWORK = "network_sha256"
"""Key of the network's digest in the description; older files and those of the shipped network have none."""
EARLIER = APPEARANCE + "class_means"
"""Array name that marks the appearance format of an earlier version; such files count as having none."""


def save_model(
    model: FittedModel,
    path: Path,
    provenance: dict[str, Any],
    appearance: KnownAppearance | None = None,
    network_digest: str = "",
) -> None:
    """Write the model, with the appearance of its objects where that is known.

    ``provenance`` (command, seed, data, report) is stored unchanged. ``network_digest`` is that of the network whose
    scores are the features; files of the shipped network have none.
    """
    arrays: dict[str, Any] = {}
    for index, (fit, table) in enumerate(zip(model.fits, model.tables, strict=True)):
        present = {name: value for name, value in (vars(fit) | vars(table)).items() if value is not None}
        arrays |= {f"{index}.{name}": np.array(value, dtype=np.float64, order="C") for name, value in present.items()}
    for name in APPEARANCE_FIELDS if appearance is not None else ():
        kind = np.float16 if name in PICTURES else np.float32
        arrays[APPEARANCE + name] = np.array(getattr(appearance, name), dtype=kind, order="C")
    description: dict[str, Any] = {
        "class_names": list(model.class_names),
        "feature_names": list(model.feature_names),
        "provenance": provenance,
    }
    if network_digest:
        description[NETWORK] = network_digest
    FORMAT.write(path, arrays, description)


def read_model(path: Path) -> FittedModel:
    """Read the model of a file, over one angle or two. Raises InputError naming the file, the fault and the remedy."""
    arrays, description = FORMAT.read(path)
    try:
        class_names = tuple(str(name) for name in description["class_names"])
        feature_names = tuple(str(name) for name in description["feature_names"])
        kind = SphericalProcessModel if "0.elevation_rad" in arrays else GaussianProcessModel
        table = _SPHERE if kind is SphericalProcessModel else _CIRCLE
        parts = [_class_parts(arrays, index, len(feature_names), table) for index in range(len(class_names))]
        model: FittedModel = kind(class_names, feature_names, [fit for fit, _ in parts], [table for _, table in parts])
        return model
    except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as fault:
        raise InputError(
            f"{path}: incomplete viewpoint model ({fault}); fit it anew with fit_viewpoint_models"
        ) from None


def read_network_digest(path: Path) -> str:
    """Digest of the network that a file's models were fitted to; "" where the file has none. Raises InputError."""
    return str(FORMAT.read(path)[1].get(NETWORK, ""))


def read_appearance(path: Path) -> KnownAppearance | None:
    """Read the appearance of the objects that a file's models describe; None where the file has none.

    Raises InputError naming the file, what is wrong and the remedy.
    """
    arrays, _ = FORMAT.read(path)
    values = {name: arrays.get(APPEARANCE + name) for name in APPEARANCE_FIELDS}
    if EARLIER in arrays or all(value is None for value in values.values()):
        return None
    try:
        kinds = {name: np.dtype(np.float32 if name in PICTURES else np.float64) for name in values}
        checked: dict[str, Any] = {name: np.asarray(value, dtype=kinds[name]) for name, value in values.items()}
        return KnownAppearance(**checked)
    except (TypeError, ValueError, AttributeError, IndexError) as fault:
        raise InputError(f"{path}: {one_line(fault)}; fit it anew with fit_viewpoint_models") from None


@dataclass(frozen=True)
class _Tabulated:
    """Layout of the tabulated posterior in a file: its arrays and their shapes."""

    table: type[Any]
    grid: tuple[int, ...]  # of the posterior
    optional: tuple[str, ...]  # fields of a fit that are absent


_CIRCLE = _Tabulated(PosteriorTable, (GRID,), ("elevation_rad",))
_SPHERE = _Tabulated(SphericalTable, (ELEVATIONS, AZIMUTHS), ())


def _class_parts(arrays: dict[str, Any], index: int, num_features: int, layout: _Tabulated) -> tuple[ClassFit, Any]:
    """Arrays of one class with their shapes checked. Raises KeyError or ValueError."""
    names = [
        item.name for part in (ClassFit, layout.table) for item in fields(part) if item.name not in layout.optional
    ]
    values = {name: arrays[f"{index}.{name}"] for name in names}
    views = len(values["azimuth_rad"])
    shapes = {
        "azimuth_rad": (views,),
        "elevation_rad": (views,),
        "targets": (views, num_features),
        "target_variances": (views, num_features),
        "prior_mean": (num_features,),
        "signal_sigma": (num_features,),
        "length_scale": (num_features,),
        "noise_covariance": (
            *(layout.grid if len(layout.grid) > 1 else values["noise_covariance"].shape[:1]),
            num_features,
            num_features,
        ),
        "coverage_rad": (),
        **{item.name: (*layout.grid, num_features) for item in fields(layout.table)},
    }
    for name, shape in ((name, shapes[name]) for name in names):
        if values[name].shape != shape or not np.all(np.isfinite(values[name])):
            raise ValueError(f"class {index}: '{name}' has a wrong shape or is not finite")
    table = layout.table(*(values.pop(item.name) for item in fields(layout.table)))
    return ClassFit(**{**values, "coverage_rad": float(values["coverage_rad"])}), table
