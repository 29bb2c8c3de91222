"""Validation of maps: consistent sizes, valid probabilities and covariances."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.world.map_prior import ID_LIMIT, ROUNDING, is_positive
from semantic_slam.maps.saved_map import MapHypotheses, MapObjects, SavedMap

SUM_ERROR = 1e-6
"""Tolerance of a sum of probabilities about one."""
MOST_OBJECTS = 1300
"""Largest number of objects in a map; the joint covariance has three rows per object."""


def check_map(saved: SavedMap) -> None:
    """Validate a map. Raises ValueError."""
    if len(saved.objects.names) > MOST_OBJECTS:
        raise ValueError(f"it has {len(saved.objects.names)} objects, and a map {MOST_OBJECTS} at most")
    _check_objects(saved.objects, len(saved.class_names))
    _check_hypotheses(saved.hypotheses, len(saved.objects), len(saved.class_names))
    looks = saved.looks
    _check_shapes(vars(looks), {"path": (len(looks.path), 3), "region": (4,)})
    if not np.isfinite(looks.path).all() or not np.isfinite(looks.region).all():
        raise ValueError("from where the robot looked is not finite")
    if not 0.0 <= saved.discarded_mass <= 1.0:
        raise ValueError("discarded_mass is no probability")


def _check_objects(objects: MapObjects, classes: int) -> None:
    count, length = len(objects.names), objects.descriptors.shape[-1] if objects.descriptors.ndim == 2 else 0
    shapes: dict[str, tuple[int, ...]] = {
        name: (count,) for name in ("ids", "existence", "missing", "moved", "sightings")
    }
    shapes |= {name: (count, length) for name in ("descriptors", "descriptor_variances")}
    shapes |= {"poses": (count, 7), "covariances": (count, 6, 6)}
    shapes |= {name: (count, classes) for name in ("class_probabilities", "class_priors")}
    _check_shapes(vars(objects), shapes)
    ids = objects.ids
    if count and (len(np.unique(ids)) < count or ids.min() < 0 or ids.max() >= ID_LIMIT):
        raise ValueError(f"ids are not different numbers from 0 to {ID_LIMIT - 1}")
    lengths = np.linalg.norm(objects.poses[:, 3:], axis=1)
    if not np.isfinite(objects.poses).all() or np.abs(lengths - 1.0).max(initial=0.0) > ROUNDING:
        raise ValueError("poses are not finite, or their quaternions not of length 1")
    for covariance in objects.covariances:
        _check_covariance(covariance, "a covariance")
    _check_probabilities(objects.existence, "existence")
    for name in ("missing", "moved"):
        values = getattr(objects, name)
        _check_probabilities(values[~np.isnan(values)], name)
    _check_distributions(objects.class_probabilities, "class_probabilities")
    untold = np.isnan(objects.class_priors).all(axis=1)
    _check_distributions(objects.class_priors[~untold], "class_priors")
    known = np.isfinite(objects.descriptors)
    if np.isinf(objects.descriptors).any() or not (objects.descriptor_variances[known] > 0.0).all():
        raise ValueError("descriptors need finite numbers, and positive variances")


def _check_hypotheses(hypotheses: MapHypotheses, objects: int, classes: int) -> None:
    count = len(hypotheses.log_weights)
    shapes = {
        "log_weights": (count,),
        "existence": (count, objects),
        "class_probabilities": (count, objects, classes),
        "states": (count, objects, 3),
        "covariances": (count, 3 * objects, 3 * objects),
    }
    _check_shapes(vars(hypotheses), shapes)
    weights = np.exp(np.minimum(hypotheses.log_weights, 1.0))
    if not count or not np.isfinite(weights).all() or abs(weights.sum() - 1.0) > SUM_ERROR:
        raise ValueError("the weights of its hypotheses do not add up to one")
    _check_probabilities(hypotheses.existence, "existence")
    _check_distributions(hypotheses.class_probabilities, "class_probabilities")
    if np.isinf(hypotheses.states).any():
        raise ValueError("states are not finite")
    for present, covariance in zip(hypotheses.present, hypotheses.covariances, strict=True):
        rows = np.repeat(present, 3)
        _check_covariance(covariance[np.ix_(rows, rows)], "a joint covariance")


def _check_shapes(values: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]]) -> None:
    for name, shape in shapes.items():
        found = np.shape(values[name])
        if found != shape:
            raise ValueError(f"{name} has the shape {found} in place of {shape}")


def _check_covariance(covariance: Array, what: str) -> None:
    if not np.isfinite(covariance).all():
        raise ValueError(f"{what} is not finite")
    tolerance = ROUNDING * float(np.abs(covariance).max(initial=0.0))
    if not len(covariance):
        return
    if not (np.abs(covariance - covariance.T).max() <= tolerance and is_positive(covariance, tolerance)):
        raise ValueError(f"{what} is not symmetric and positive semi-definite")


def _check_probabilities(values: Array, what: str) -> None:
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise ValueError(f"{what} is no probability")


def _check_distributions(values: Array, what: str) -> None:
    _check_probabilities(values, what)
    if values.shape[-1] and np.abs(values.sum(axis=-1) - 1.0).max(initial=0.0) > SUM_ERROR:
        raise ValueError(f"{what} do not add up to one")
