"""``query_place``: objects at a place, and objects missing from it; used by all commands and services."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.answers.question import check_limits
from semantic_slam.answers.region import Region, inside, within
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior


@dataclass(frozen=True, kw_only=True)
class PlacedObject:
    """An object with the probabilities that it is in the queried region, or has left it."""

    object_id: int
    name: str
    here: float  # probability that it exists and stands there now
    gone: float  # probability that it stood there, and is missing or stands elsewhere now
    pose: Array  # (7,) in the map frame; from the prior map where the belief no longer has the object
    covariance: Array  # (6, 6) along the axes of map


def query_place(
    belief: HybridBelief,
    region: Region | None = None,
    least_probability: float = 0.0,
    map_prior: MapPrior | None = None,
) -> tuple[PlacedObject, ...]:
    """Objects in the region, or gone from it, with at least the given probability; likeliest present first.

    ``region`` None: everywhere. The run's ``map_prior`` gives the former positions of moved objects, and objects that
    the belief no longer contains. Raises InputError.
    """
    check_limits(region, least_probability)
    known = {own.object_id: own for own in map_prior.objects} if map_prior is not None else {}
    existence = np.clip(np.nan_to_num(belief.existence), 0.0, 1.0)
    inside_now = inside(belief, region)
    here = existence * inside_now
    gone = _left(belief, existence, known) * inside_now + _moved_away(belief, existence, known, inside_now, region)
    placed = [
        PlacedObject(
            object_id=number,
            name=belief.object_names[row],
            here=float(here[row]),
            gone=float(min(gone[row], 1.0)),
            pose=belief.object_poses[row],
            covariance=belief.object_covariances[row],
        )
        for row, number in enumerate(belief.object_ids.tolist())
    ]
    held = set(belief.object_ids.tolist())
    placed += [_no_longer_held(own, region) for number, own in known.items() if number not in held]
    enough = [own for own in placed if max(own.here, own.gone) >= least_probability]
    return tuple(sorted(enough, key=lambda own: (-own.here, -own.gone)))


def _left(belief: HybridBelief, existence: Array, known: dict[int, ObjectPrior]) -> Array:
    """(O,) probabilities that objects were at their believed place and are gone.

    A run that does not estimate disappearance gives them for map objects, by the decrease of their existence.
    """
    numbers = belief.object_ids.tolist()
    before = np.array([known[number].existence if number in known else 0.0 for number in numbers])
    doubted = np.maximum(before - existence, 0.0)
    return np.asarray(np.where(np.isfinite(belief.missing), np.clip(belief.missing, 0.0, 1.0), doubted))


def _moved_away(
    belief: HybridBelief, existence: Array, known: dict[int, ObjectPrior], inside_now: Array, region: Region | None
) -> Array:
    """(O,) probabilities that map objects were in the region and were moved out of it.

    An object is outside now because it was moved there, or because it was outside before and was not moved: the former
    has P(outside) - (1 - P(moved)) P(it stood outside). Where it was moved to does not depend on where it stood.
    """
    gone = np.zeros(len(existence))
    for row, number in enumerate(belief.object_ids.tolist()):
        if number in known and belief.moved[row] > 0.0:
            moved, stood = float(belief.moved[row]), _stood(known[number], region)
            moved_outside = (1.0 - inside_now[row]) - (1.0 - moved) * (1.0 - stood)
            gone[row] = stood * np.clip(moved_outside, 0.0, moved)
    return existence * gone


def _no_longer_held(own: ObjectPrior, region: Region | None) -> PlacedObject:
    """Result for a map object that no hypothesis contains any more."""
    gone = own.existence * _stood(own, region)
    return PlacedObject(
        object_id=own.object_id, name=own.name, here=0.0, gone=gone, pose=own.pose, covariance=own.covariance
    )


def _stood(own: ObjectPrior, region: Region | None) -> float:
    """Probability that the object was in the region according to the map."""
    return float(within(own.pose[None], own.covariance[None], region)[0])
