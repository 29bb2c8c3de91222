"""Map from a belief: marginals of each object over all hypotheses, without correlations between objects."""

import hashlib
import json

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Index
from semantic_slam.geometry.object_coordinates import object_coordinates
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior, parse_map_prior
from semantic_slam.maps.as_prior import independent, saved_map_of_prior
from semantic_slam.maps.checks import MOST_OBJECTS
from semantic_slam.maps.map_file import with_id
from semantic_slam.maps.saved_map import MapObjects, Provenance, SavedMap

MOVES = 0.5
"""Probability of motion above which an object is left out of maps."""


def saved_map_of_belief(belief: HybridBelief, run: RunConfiguration) -> SavedMap:
    """Map with a single hypothesis of the marginals. Raises InputError where nothing is mapped."""
    objects = map_objects(belief)
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


def mapped_rows(belief: HybridBelief) -> Index:
    """Rows of the belief's objects that go into a map: localised and static ones."""
    known = np.isfinite(belief.object_poses).all(axis=-1) & np.isfinite(belief.object_covariances).all(axis=(-2, -1))
    return np.flatnonzero(known & ~(belief.moving > MOVES))


def map_objects(belief: HybridBelief) -> MapObjects:
    """Marginals of the belief's mapped objects. Raises InputError where there are none."""
    rows = mapped_rows(belief)
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
        started_from=_id(prior),
        keyframe=int(belief.keyframe),
        stamp_ns=int(belief.stamp_ns),
        ancestors=_ancestors(prior),
    )


def ancestors_of(run: RunConfiguration) -> tuple[str, ...]:
    """Sorted ids of all maps whose information a run was given at its start. Raises InputError."""
    return _ancestors(_prior(run))


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
