"""Conversion of saved maps to run priors, and of the legacy ``objects.json`` format to saved maps."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import transport
from semantic_slam.geometry.object_coordinates import ObjectCoordinates, object_coordinates
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.saved_map import MapHypotheses, MapObjects, Provenance, SavedMap


def map_prior_of(saved: SavedMap) -> MapPrior:
    """Map prior with the objects' marginals, and their joint covariance where the map has it."""
    objects = saved.objects
    items = tuple(
        ObjectPrior(
            object_id=int(number),
            name=objects.names[row],
            pose=objects.poses[row],
            covariance=objects.covariances[row],
            class_probabilities=dict(zip(saved.class_names, objects.class_probabilities[row].tolist(), strict=True)),
            existence=float(objects.existence[row]),
            **_descriptor(objects, row),
        )
        for row, number in enumerate(objects.ids)
    )
    joint = joint_covariance(saved) if saved.has_cross_covariances and len(objects) > 1 else None
    ancestors = tuple(sorted(saved.origins))
    return MapPrior(items, saved.descriptor_space, joint, saved.map_id, saved.state_space, ancestors)


def joint_covariance(saved: SavedMap) -> Array:
    """(3 O, 3 O) joint covariance of the map's coordinates over all hypotheses, with the marginals as blocks.

    In a hypothesis that lacks an object, that object has its marginal, independent of all others.
    """
    hypotheses, weights, coordinates = saved.hypotheses, np.exp(saved.hypotheses.log_weights), saved.coordinates
    means, own = coordinates.of_poses(saved.objects.poses), coordinates.of_covariances(saved.objects.covariances)
    size = 3 * len(means)
    total, shift = np.zeros((size, size)), np.zeros((len(weights), size))
    for row, weight in enumerate(weights):
        filled, present = _block_diagonal(own), np.repeat(hypotheses.present[row], 3)
        filled[np.ix_(present, present)] = hypotheses.covariances[row][np.ix_(present, present)]
        off = coordinates.difference(hypotheses.states[row], means)
        shift[row] = np.where(hypotheses.present[row][:, None], off, 0.0).ravel()
        total += weight * filled
    centred = shift - weights @ shift
    return _with_own_blocks(total + np.einsum("h,hi,hj->ij", weights, centred, centred), own)


def _with_own_blocks(joint: Array, own: Array) -> Array:
    """Covariance with the diagonal blocks ``own`` (O, 3, 3) and the correlations of ``joint``."""
    changed = joint.copy()
    for row, block in enumerate(own):
        at = slice(3 * row, 3 * row + 3)
        change = transport(joint[at, at], block)
        changed[at] = change @ changed[at]
        changed[:, at] = changed[:, at] @ change.T
        changed[at, at] = block
    return np.asarray(0.5 * (changed + changed.T))


def saved_map_of_prior(prior: MapPrior) -> SavedMap:
    """Saved map of an ``objects.json``: one hypothesis with independent objects."""
    names = tuple(sorted({name for item in prior.objects for name in item.class_probabilities}))
    count, length = len(prior.objects), max((len(item.descriptor) for item in prior.objects), default=0)
    descriptors, variances = np.full((2, count, length), np.nan)
    for row, item in enumerate(prior.objects):
        if len(item.descriptor) == length:
            descriptors[row], variances[row] = item.descriptor, item.descriptor_variance
    unknown = np.full(count, np.nan)
    objects = MapObjects(
        ids=np.array([item.object_id for item in prior.objects], dtype=np.int64),
        names=tuple(item.name for item in prior.objects),
        poses=np.array([item.pose for item in prior.objects]).reshape(-1, 7),
        covariances=np.array([item.covariance for item in prior.objects]).reshape(-1, 6, 6),
        existence=np.array([item.existence for item in prior.objects]),
        class_probabilities=np.array([_classes(item, names) for item in prior.objects]).reshape(count, len(names)),
        class_priors=np.full((count, len(names)), np.nan),
        descriptors=descriptors,
        descriptor_variances=variances,
        missing=unknown,
        moved=unknown,
        sightings=unknown,
    )
    return SavedMap(
        class_names=names,
        objects=objects,
        hypotheses=independent(objects, object_coordinates(prior.state_space)),
        has_cross_covariances=False,
        descriptor_space=prior.descriptor_space,
        state_space=prior.state_space,
        provenance=Provenance(ancestors=tuple(sorted({*prior.ancestors, prior.map_id} - {""}))),
    )


def independent(objects: MapObjects, coordinates: ObjectCoordinates) -> MapHypotheses:
    """One hypothesis made of the objects' independent marginals."""
    joint = _block_diagonal(coordinates.of_covariances(objects.covariances))
    return MapHypotheses(
        log_weights=np.zeros(1),
        existence=objects.existence[None],
        class_probabilities=objects.class_probabilities[None],
        states=coordinates.of_poses(objects.poses)[None],
        covariances=joint[None],
    )


def _block_diagonal(blocks: Array) -> Array:
    joint = np.zeros((3 * len(blocks), 3 * len(blocks)))
    rows = np.arange(len(joint)).reshape(-1, 3)
    joint[rows[:, :, None], rows[:, None, :]] = blocks
    return joint


def _classes(item: ObjectPrior, names: tuple[str, ...]) -> Array:
    given = np.array([item.class_probabilities.get(name, 0.0) for name in names])
    return np.asarray(given / given.sum()) if given.sum() > 0.0 else np.full(len(names), 1.0 / max(len(names), 1))


def _descriptor(objects: MapObjects, row: int) -> dict[str, Array]:
    mean, variance = objects.descriptors[row], objects.descriptor_variances[row]
    return {"descriptor": mean, "descriptor_variance": variance} if np.isfinite([mean, variance]).all() else {}
