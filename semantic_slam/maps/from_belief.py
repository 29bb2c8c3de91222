"""Map from a belief: marginals of each object over all hypotheses, without correlations between objects."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.evaluation.record import json_object
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.object_coordinates import object_coordinates
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.belief_views import ObjectPlace
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior, parse_map_prior
from semantic_slam.maps.as_prior import independent, saved_map_of_prior
from semantic_slam.maps.checks import MOST_OBJECTS
from semantic_slam.maps.map_file import with_id
from semantic_slam.maps.saved_map import MapObjects, Provenance, SavedMap

MOVES = 0.5
"""Probability of motion above which an object is left out of maps."""
LIKELIER = 0.5
NEARLY = 1.0 - 1e-6
AS_WIDE = 0.99
"""Share of the variances of its start that a robot keeps until it finds out where it is: smoothers round them."""
ANY_HEADING_RAD2 = NEARLY * np.pi**2
"""Least variance of the heading of a robot that was carried to new ground: odometry does not tell how it was turned."""


def saved_map_of_belief(belief: HybridBelief, run: RunConfiguration) -> SavedMap:
    """Map with a single hypothesis of the marginals. Raises InputError where nothing is mapped."""
    objects = map_objects(belief, run)
    return SavedMap(
        class_names=belief.class_names,
        objects=objects,
        hypotheses=independent(objects, object_coordinates(belief.state_space)),
        has_cross_covariances=False,
        discarded_mass=min(float(belief.discarded_mass), 1.0),
        descriptor_space=str(_settings(run).get("semantic_model", {}).get("space", "")),
        state_space=belief.state_space,
        provenance=provenance_of(belief, run),
    )


def mapped_rows(belief: HybridBelief, run: RunConfiguration) -> Index:
    """Rows of the belief's objects that go into a map: localised and static ones."""
    rows = _static_rows(belief)
    return rows[~_are_unplaced(belief, rows, run)]


def num_unplaced(belief: HybridBelief, run: RunConfiguration) -> int:
    """Number of static objects that are not in the map, as the robot is on new ground since it was carried."""
    return len(_static_rows(belief)) - len(mapped_rows(belief, run))


def _static_rows(belief: HybridBelief) -> Index:
    known = np.isfinite(belief.object_poses).all(axis=-1) & np.isfinite(belief.object_covariances).all(axis=(-2, -1))
    return np.flatnonzero(known & ~(belief.moving > MOVES))


def _are_unplaced(belief: HybridBelief, rows: Index, run: RunConfiguration) -> Flags:
    """(R,) whether objects are likelier in the frame of a robot on new ground, whose place in map is not known.

    Such a frame may be turned by any angle, so all of its objects are stated about its origin. A robot that does not
    know where it started was not carried: what its start leaves open is no new ground.
    """
    revision: Mapping[str, Any] = json_object(run.configuration).get("revision", {})
    on_new_ground = _are_on_new_ground(belief.pose_covariances, np.asarray(run.initial_covariance))
    if not revision.get("carried_probability") or not np.exp(belief.log_weights) @ on_new_ground > LIKELIER:
        return np.zeros(len(rows), dtype=bool)
    least, most = NEARLY * float(revision["carried_m"]) ** 2, _left_open_m2(np.asarray(run.initial_covariance))
    most = most if most >= least else np.inf
    shares = [_share_of_broad(belief.places_of(row), least, most) for row in rows.tolist()]
    return np.array([share > LIKELIER for share in shares], dtype=bool)


def _are_on_new_ground(covariances: Array, start: Array) -> Flags:
    """(H,) whether poses with (H, 6, 6) may be turned by any angle, beyond what the ``start`` (6, 6) leaves open."""
    headings = covariances[:, -1, -1]
    by_start = (headings >= AS_WIDE * start[-1, -1]) & (_narrowest(covariances) >= _left_open_m2(start))
    return np.asarray((headings >= ANY_HEADING_RAD2) & ~by_start)


def _left_open_m2(start: Array) -> float:
    """Least variance of places in every direction, where a ``start`` (6, 6) leaves all headings open; else infinite."""
    return AS_WIDE * float(_narrowest(start)) if start[-1, -1] >= ANY_HEADING_RAD2 else np.inf


def _narrowest(covariances: Array) -> Array:
    """(...,) least variance of (..., d, d) in any direction of the plane [m^2]."""
    return np.asarray(np.linalg.eigvalsh(covariances[..., :2, :2])[..., 0])


def _share_of_broad(places: Sequence[ObjectPlace], least: float, most: float) -> float:
    """Probability of places whose variance is from ``least`` up to ``most`` [m^2] in the narrowest direction."""
    narrowest = [_narrowest(np.asarray(own.covariance)) for own in places]
    return sum(own.probability for own, own_m2 in zip(places, narrowest, strict=True) if least <= own_m2 < most)


def map_objects(belief: HybridBelief, run: RunConfiguration) -> MapObjects:
    """Marginals of the belief's mapped objects. Raises InputError where there are none."""
    rows = mapped_rows(belief, run)
    if not len(rows) and len(_static_rows(belief)):
        raise InputError(
            "all that was seen was seen on new ground since the robot was carried, so there is no map to save;"
            " if nobody lifted it, set revision.carried_probability: 0"
        )
    if not len(rows):
        raise InputError("nothing was mapped, so there is no map to save; drive past objects first")
    return MapObjects(
        ids=belief.object_ids[rows].astype(np.int64),
        names=tuple(belief.object_names[row] or str(belief.object_ids[row]) for row in rows),
        poses=belief.object_poses[rows],
        covariances=belief.object_covariances[rows],
        existence=np.clip(belief.existence[rows], 0.0, 1.0),
        class_probabilities=belief.class_probabilities[rows],
        class_priors=np.full((len(rows), len(belief.class_names)), np.nan),
        descriptors=belief.descriptors[rows],
        descriptor_variances=belief.descriptor_covariances[rows],
        missing=belief.missing[rows],
        moved=belief.moved[rows],
        sightings=np.full(len(rows), np.nan),
    )


def provenance_of(belief: HybridBelief, run: RunConfiguration) -> Provenance:
    """Provenance of a belief."""
    prior = _prior(run)
    return Provenance(
        source=run.source,
        revision=run.revision,
        configuration_sha256=hashlib.sha256(run.configuration.encode()).hexdigest(),
        run_id=run.run_id,
        began_ns=int(run.stamp_ns),
        started_from=_id(prior),
        keyframe=int(belief.keyframe),
        stamp_ns=int(belief.stamp_ns),
        ancestors=_ancestors(prior),
    )


def ancestors_of(run: RunConfiguration) -> tuple[str, ...]:
    """Sorted ids of all maps that a run was given information of at its start, and of its recording.

    Raises InputError.
    """
    own = Provenance(source=run.source, run_id=run.run_id, began_ns=int(run.stamp_ns)).recording
    return tuple(sorted({*_ancestors(_prior(run)), own} - {""}))


def _prior(run: RunConfiguration) -> MapPrior | None:
    """Map that a run started from, None for none. Raises InputError."""
    return parse_map_prior(run.map_prior, "map prior") if run.map_prior else None


def _ancestors(prior: MapPrior | None) -> tuple[str, ...]:
    return tuple(sorted({_id(prior), *prior.ancestors} - {""})) if prior else ()


def _id(prior: MapPrior | None) -> str:
    """Id of the map that a run started from, "" for none; for an ``objects.json``, the digest of its content."""
    if prior is None:
        return ""
    if prior.map_id or len(prior.objects) > MOST_OBJECTS:
        return prior.map_id
    return with_id(saved_map_of_prior(prior)).map_id


def _settings(run: RunConfiguration) -> dict[str, dict[str, object]]:
    return dict(json.loads(run.configuration))
