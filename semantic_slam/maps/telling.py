"""Presentation of a map as a text table and as JSON-compatible values."""

from dataclasses import asdict
from typing import Any

import numpy as np

from semantic_slam.configuration.configuration import SPATIAL
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import largest_sigma_m
from semantic_slam.inference.protocol import source_entry
from semantic_slam.maps.saved_map import SavedMap

SCHEMA_VERSION = 1


def lines_of(known: SavedMap) -> list[str]:
    """Text lines: provenance, then one line per object; sigma is that along its largest axis."""
    objects, provenance = known.objects, known.provenance
    axes = "xyz" if known.state_space == SPATIAL else "xy"
    columns = "  ".join(f"{f'{axis} [m]':>8}" for axis in axes)
    together = "what they have in common" if known.has_cross_covariances else "each object by itself"
    bag = source_entry(provenance.source, "path") or "an unknown bag"
    lines = [
        f"map {known.map_id}: {len(objects)} objects, {len(known.hypotheses)} hypotheses, {together}",
        f"run {provenance.run_id or 'not known'}, keyframe {provenance.keyframe}, of {bag}"
        + (f", started from map {provenance.started_from}" if provenance.started_from else ""),
        f"{'object':>10}  {'exists':>6}  {columns}  {'sigma [m]':>9}  {'seen':>5}  class, name",
    ]
    for row, number in enumerate(objects.ids.tolist()):
        place = "  ".join(f"{value:8.2f}" for value in objects.poses[row, : len(axes)].tolist())
        sigma = largest_sigma_m(objects.covariances[row], len(axes))
        seen = "-" if np.isnan(objects.sightings[row]) else f"{objects.sightings[row]:.0f}"
        lines.append(
            f"{number:10d}  {objects.existence[row]:6.3f}  {place}  {sigma:9.3f}"
            f"  {seen:>5}  {_class_text(known, row)}{objects.names[row]}"
        )
    return lines


def as_json(known: SavedMap) -> dict[str, Any]:
    """JSON-compatible values of everything but covariances between objects; NaN as None."""
    objects = known.objects
    rows = [
        {
            "id": number,
            "name": objects.names[row],
            "pose": objects.poses[row].tolist(),
            "covariance": objects.covariances[row].tolist(),
            "existence": float(objects.existence[row]),
            "class_probabilities": _by_name(known, objects.class_probabilities[row]),
            "class_priors": _by_name(known, objects.class_priors[row]),
            "descriptor": _or_none(objects.descriptors[row]),
            "descriptor_variance": _or_none(objects.descriptor_variances[row]),
            "missing": _or_none(objects.missing[row]),
            "moved": _or_none(objects.moved[row]),
            "sightings": _or_none(objects.sightings[row]),
        }
        for row, number in enumerate(objects.ids.tolist())
    ]
    return {
        "schema_version": SCHEMA_VERSION,
        "map_id": known.map_id,
        "frame": "map",
        "state_space": known.state_space,
        "provenance": asdict(known.provenance) | {"ancestors": sorted(known.ancestors)},
        "has_cross_covariances": known.has_cross_covariances,
        "weights": np.exp(known.hypotheses.log_weights).tolist(),
        "discarded_mass": known.discarded_mass,
        "objects": rows,
    }


def _class_text(known: SavedMap, row: int) -> str:
    if not known.class_names:
        return ""
    best = int(np.argmax(known.objects.class_probabilities[row]))
    return f"{known.class_names[best]} {known.objects.class_probabilities[row, best]:.3f}, "


def _by_name(known: SavedMap, values: Array) -> dict[str, float] | None:
    """(C,) numbers keyed by class name, or None where they are unknown."""
    return dict(zip(known.class_names, values.tolist(), strict=True)) if np.isfinite(values).all() else None


def _or_none(values: Array) -> Any:
    """Numbers as lists, or None where any is not finite."""
    return np.asarray(values).tolist() if np.isfinite(values).all() else None
