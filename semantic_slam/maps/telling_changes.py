"""Presentation of map changes as a text table and as JSON-compatible values."""

from typing import Any

import numpy as np

from semantic_slam.maps.differences import MapDifference, NewObject, OldObject

SCHEMA_VERSION = 1
STATED = 0.5
"""Smallest probability at which an object is reported as new."""
SHARED = "both maps hold some of the same observations: what is the same is less sure than stated"
"""Line about maps that are not independent."""


def change_lines(difference: MapDifference) -> list[str]:
    """Text lines: the alignment of the maps, then one line per object."""
    shift = ", ".join(f"{axis} {value:.2f} m" for axis, value in zip("xyz", difference.T_old_new[:-1], strict=False))
    probability = difference.alignment_probability
    how = "one frame" if difference.same_frame else f"aligned by association (P = {probability:.3f})"
    lines = [f"{how}; the new map's origin at {shift}, {np.rad2deg(difference.T_old_new[-1]):.1f} deg of the old one"]
    if difference.shares_evidence:
        lines.append(SHARED)
    lines.append(f"{'':9}  {'P':>6}  {'object':>10}  {'now':>10}  name")
    for own in difference.old:
        now = "-" if own.new_id is None else str(own.new_id)
        away = _away(own) if own.kind == "displaced" else ""
        lines.append(
            f"{own.kind:9}  {own.probabilities[own.kind]:6.3f}  {own.object_id:10d}  {now:>10}  {own.name}{away}"
        )
    for new in difference.new:
        if new.probability >= STATED:
            place = ", ".join(f"{value:.2f}" for value in new.position)
            lines.append(f"{'new':9}  {new.probability:6.3f}  {'-':>10}  {new.object_id:10d}  {new.name}, at {place} m")
    return lines


def _away(own: OldObject) -> str:
    """How far an object was displaced; without a distance where more than one object may be it."""
    return ", to one of several" if own.new_id is None else f", by {own.distance_m:.2f} +- {own.sigma_m:.2f} m"


def changes_as_json(difference: MapDifference) -> dict[str, Any]:
    """JSON-compatible values at full precision; NaN as None."""
    return {
        "schema_version": SCHEMA_VERSION,
        "same_frame": difference.same_frame,
        "alignment_probability": difference.alignment_probability,
        "shares_evidence": difference.shares_evidence,
        "T_old_new": difference.T_old_new.tolist(),
        "old": [_old(own) for own in difference.old],
        "new": [_new(own) for own in difference.new],
    }


def _old(own: OldObject) -> dict[str, Any]:
    known = own.new_id is not None
    return {
        "id": own.object_id,
        "name": own.name,
        "kind": own.kind,
        "probabilities": own.probabilities,
        "new_id": own.new_id,
        "distance_m": own.distance_m if known else None,
        "sigma_m": own.sigma_m if known else None,
    }


def _new(own: NewObject) -> dict[str, Any]:
    return {"id": own.object_id, "name": own.name, "probability": own.probability, "position": own.position.tolist()}
