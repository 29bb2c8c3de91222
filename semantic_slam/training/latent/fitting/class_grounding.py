"""Classes of the latent space from a few tagged instances: their Gaussians, or nearest neighbours."""

from collections.abc import Mapping, Sequence

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.grounding import Grounding

PRIOR_INSTANCES = 4.0
"""Weight of the spread of all descriptors, in tagged instances, when the spread within classes is estimated."""


def ground(names: Sequence[str], descriptors: Array, tags: Mapping[str, str]) -> Grounding:
    """Gaussians of the classes in ``tags`` {instance: class}; ``descriptors`` (N, L) belong to ``names``.

    With one or two tagged instances a class has no covariance of its own: classes share the spread within classes,
    drawn towards the spread of all descriptors. Raises InputError when no tag names an instance of the model.
    """
    rows = tagged_rows(names, tags)
    classes = tuple(sorted({class_name for _, class_name in rows}))
    groups = [np.array([descriptors[row] for row, name in rows if name == class_name]) for class_name in classes]
    means = np.array([group.mean(axis=0) for group in groups])
    scatter = sum(((group - mean) ** 2).sum(axis=0) for group, mean in zip(groups, means, strict=True))
    freedom = sum(len(group) - 1 for group in groups)
    # Between all instances classes differ too: half of that variance is what a class alone may be taken to have.
    prior = 0.5 * descriptors.var(axis=0)
    within = (scatter + PRIOR_INSTANCES * prior) / (freedom + PRIOR_INSTANCES)
    counts = np.array([len(group) for group in groups])
    return Grounding(classes, means, np.sqrt(within * (1.0 + 1.0 / counts[:, None])))


def nearest_class(names: Sequence[str], descriptors: Array, tags: Mapping[str, str], queries: Array) -> list[str]:
    """Class of the tagged instance next to each of the (B, L) ``queries``; distances in units of the spread."""
    rows = tagged_rows(names, tags)
    tagged = descriptors[[row for row, _ in rows]]
    scale = np.maximum(descriptors.std(axis=0), 1e-9)
    distance = np.linalg.norm((queries[:, None, :] - tagged) / scale, axis=-1)
    return [rows[index][1] for index in distance.argmin(axis=1)]


def tagged_rows(names: Sequence[str], tags: Mapping[str, str]) -> list[tuple[int, str]]:
    """(row, class) of the instances that carry a tag; raises InputError without any."""
    rows = [(row, tags[name]) for row, name in enumerate(names) if name in tags]
    if not rows:
        raise InputError(f"tags name none of the instances ({', '.join(names[:5])} ...); name some of them")
    return rows
