"""Latent model files: weights, descriptors and a JSON description in one safetensors file; data only."""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError, one_line
from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.change_model import ChangeModel
from semantic_slam.latent.grounding import Grounding
from semantic_slam.latent.latent_model import FeatureNoise, Instances, LatentModel
from semantic_slam.latent.smooth_network import Layer, SmoothNetwork
from semantic_slam.model_files import Arrays, ModelFormat

SPACE_DIGITS = 16
"""Number of hexadecimal digits in the name of a latent space."""
REMEDY = "make one with train_latent_model"
FORMAT = ModelFormat(kind="latent_descriptor", schema_version=1, remedy=REMEDY)


def save_latent_model(model: LatentModel, extractor: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Write the model and the (numpy) state of its extractor; ``model.provenance`` is stored unchanged."""
    arrays: Arrays = {f"extractor.{name}": np.ascontiguousarray(value) for name, value in extractor.items()}
    networks = {"decoder": model.decoder, "encoder": model.encoder}
    if model.changes is not None:
        networks["changes"] = model.changes.network
    for name, network in networks.items():
        for index, layer in enumerate(network.layers):
            arrays[f"{name}.{index}.weight"] = np.ascontiguousarray(layer.weight, dtype=np.float32)
            arrays[f"{name}.{index}.bias"] = np.ascontiguousarray(layer.bias, dtype=np.float32)
    for name, noise in (("noise", model.noise), ("turntable_noise", model.turntable_noise)):
        arrays[f"{name}.sigma"] = np.asarray(noise.sigma, dtype=np.float64)
        arrays[f"{name}.temper"] = np.array(noise.temper, dtype=np.float64)
    if model.new_factor is not None:
        arrays["new_factor"] = np.array(model.new_factor, dtype=np.float64)
    arrays["instances.descriptors"] = np.ascontiguousarray(model.instances.descriptors, dtype=np.float64)
    if model.grounding is not None:
        arrays["grounding.mean"] = np.ascontiguousarray(model.grounding.mean)
        arrays["grounding.sigma"] = np.ascontiguousarray(model.grounding.sigma)
    description = {
        "formulation": model.formulation,
        "instance_names": list(model.instances.names),
        "class_names": list(model.class_names),
        "provenance": model.provenance,
    }
    FORMAT.write(path, arrays, description)


def read_latent_model(path: Path) -> LatentModel:
    """Read the numpy part of a file. Raises InputError naming the file, the fault and the remedy."""
    arrays, description = FORMAT.read(path)
    try:
        names = tuple(str(name) for name in description["instance_names"])
        return LatentModel(
            decoder=_network(arrays, "decoder"),
            encoder=_network(arrays, "encoder"),
            noise=_noise(arrays, "noise"),
            turntable_noise=_noise(arrays, "turntable_noise"),
            instances=Instances(names, _array(arrays, "instances.descriptors", 2)),
            grounding=_grounding(arrays, description["class_names"]),
            changes=ChangeModel(_network(arrays, "changes")) if "changes.0.weight" in arrays else None,
            new_factor=float(_array(arrays, "new_factor", 0)) if "new_factor" in arrays else None,
            formulation=str(description["formulation"]),
            provenance=dict(description["provenance"]),
            space=space_of(arrays),
        )
    except (KeyError, TypeError, ValueError) as fault:
        raise InputError(f"{path}: incomplete latent model ({one_line(fault)}); {REMEDY}") from None


def space_of(arrays: Arrays) -> str:
    """Name of a file's latent space: a digest of extractor and decoder, which alone define the descriptors."""
    digest = sha256()
    for name in sorted(arrays):
        if name.startswith(("extractor.", "decoder.")):
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return f"latent-{digest.hexdigest()[:SPACE_DIGITS]}"


def _network(arrays: Arrays, name: str) -> SmoothNetwork:
    count = sum(key.startswith(f"{name}.") and key.endswith(".weight") for key in arrays)
    return SmoothNetwork(
        [
            Layer(_array(arrays, f"{name}.{index}.weight", 2), _array(arrays, f"{name}.{index}.bias", 1))
            for index in range(count)
        ]
    )


def _noise(arrays: Arrays, name: str) -> FeatureNoise:
    return FeatureNoise(_array(arrays, f"{name}.sigma", 1), float(_array(arrays, f"{name}.temper", 0)))


def _grounding(arrays: Arrays, class_names: Sequence[str]) -> Grounding | None:
    if not class_names:
        return None
    mean, sigma = _array(arrays, "grounding.mean", 2), _array(arrays, "grounding.sigma", 2)
    if not (len(class_names) == len(mean) and mean.shape == sigma.shape and np.all(sigma > 0.0)):
        raise ValueError("the classes do not fit their Gaussians")
    return Grounding(tuple(str(name) for name in class_names), mean, sigma)


def _array(arrays: Arrays, name: str, dimensions: int) -> Array:
    value = np.asarray(arrays[name], dtype=np.float64)
    if value.ndim != dimensions or not np.all(np.isfinite(value)):
        raise ValueError(f"'{name}' has a wrong shape or is not finite")
    return value
