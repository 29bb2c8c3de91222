"""Viewpoint model files: arrays and a JSON description in one safetensors file; nothing in it is executed."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.model_files import ModelFormat
from semantic_slam.viewpoint.appearance import APPEARANCE_FIELDS, PICTURES, KnownAppearance
from semantic_slam.viewpoint.gaussian_process import GRID, ClassFit, GaussianProcessModel, PosteriorTable

FORMAT = ModelFormat(
    kind="gp_independent", schema_version=1, remedy="check semantic_model.path, or make one with fit_viewpoint_models"
)
APPEARANCE = "appearance."
"""What names of arrays begin with that tell what the objects look like; older files have none."""
EARLIER = APPEARANCE + "class_means"
"""A name that files have which tell it as an earlier version did; they count as files that do not tell."""


def save_model(
    model: GaussianProcessModel, path: Path, provenance: dict[str, Any], appearance: KnownAppearance | None = None
) -> None:
    """Write the model, with what its objects look like where that is known.

    ``provenance`` (command, seed, data, network, report) is kept with it as it is.
    """
    arrays = {}
    for index, parts in enumerate(zip(model.fits, model.tables, strict=True)):
        for part in parts:
            for item in fields(part):
                value = np.array(getattr(part, item.name), dtype=np.float64, order="C")
                arrays[f"{index}.{item.name}"] = value
    for name in APPEARANCE_FIELDS if appearance is not None else ():
        kind = np.float16 if name in PICTURES else np.float32
        arrays[APPEARANCE + name] = np.array(getattr(appearance, name), dtype=kind, order="C")
    description = {
        "class_names": list(model.class_names),
        "feature_names": list(model.feature_names),
        "provenance": provenance,
    }
    FORMAT.write(path, arrays, description)


def read_model(path: Path) -> GaussianProcessModel:
    """The model in a file. Raises InputError naming the file, what is wrong and the remedy."""
    arrays, description = FORMAT.read(path)
    try:
        class_names = tuple(str(name) for name in description["class_names"])
        feature_names = tuple(str(name) for name in description["feature_names"])
        parts = [_class_parts(arrays, index, len(feature_names)) for index in range(len(class_names))]
        return GaussianProcessModel(
            class_names, feature_names, [fit for fit, _ in parts], [table for _, table in parts]
        )
    except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as fault:
        raise InputError(
            f"{path}: incomplete viewpoint model ({fault}); fit it anew with fit_viewpoint_models"
        ) from None


def read_appearance(path: Path) -> KnownAppearance | None:
    """What the objects look like that the models in a file are of; None in a file that does not tell.

    Raises InputError naming the file, what is wrong and the remedy.
    """
    arrays, _ = FORMAT.read(path)
    values = {name: arrays.get(APPEARANCE + name) for name in APPEARANCE_FIELDS}
    if EARLIER in arrays or all(value is None for value in values.values()):
        return None
    try:
        kinds = {name: np.dtype(np.float32 if name in PICTURES else np.float64) for name in values}
        told: dict[str, Any] = {name: np.asarray(value, dtype=kinds[name]) for name, value in values.items()}
        return KnownAppearance(**told)
    except (TypeError, ValueError, AttributeError, IndexError) as fault:
        raise InputError(f"{path}: {' '.join(str(fault).split())}; fit it anew with fit_viewpoint_models") from None


def read_provenance(path: Path) -> dict[str, Any]:
    """What the file says of its own making. Raises InputError."""
    return dict(FORMAT.read(path)[1].get("provenance", {}))


def _class_parts(arrays: dict[str, Any], index: int, num_features: int) -> tuple[ClassFit, PosteriorTable]:
    """The arrays of one class, their shapes checked; raises KeyError or ValueError."""
    names = [item.name for part in (ClassFit, PosteriorTable) for item in fields(part)]
    values = {name: arrays[f"{index}.{name}"] for name in names}
    views = len(values["azimuth_rad"])
    shapes = {
        "azimuth_rad": (views,),
        "targets": (views, num_features),
        "target_variances": (views, num_features),
        "prior_mean": (num_features,),
        "signal_sigma": (num_features,),
        "length_scale": (num_features,),
        "noise_covariance": (len(values["noise_covariance"]), num_features, num_features),
        "coverage_rad": (),
        **{item.name: (GRID, num_features) for item in fields(PosteriorTable)},
    }
    for name, shape in shapes.items():
        if values[name].shape != shape or not np.all(np.isfinite(values[name])):
            raise ValueError(f"class {index}: '{name}' has a wrong shape or is not finite")
    table = PosteriorTable(*(values.pop(item.name) for item in fields(PosteriorTable)))
    return ClassFit(**{**values, "coverage_rad": float(values["coverage_rad"])}), table
