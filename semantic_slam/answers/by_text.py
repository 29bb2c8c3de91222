"""Text queries by embedding: calibrated probabilities that objects match a name, instead of raw cosines.

Text and image embeddings occupy different regions (modality gap), so texts are first compared with each other: a name
is represented by the direction from the mean of all named texts to its own. Along that direction, the mean vectors of
objects are distributed like all vectors, or, for objects of that name, around a shift; the shift is a share rho of the
spread between objects. The unknown rho is inferred from all objects and names jointly, from the evidence that each
object has one of the names or none. A name is compared along its own direction with the background alone, which is
exact for class-specific features with a common reference (Baggenstoss 2003).
"""

from collections.abc import Mapping

import numpy as np

from semantic_slam.answers.appearances import Appearances
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.viewpoint.embeddings.vectors import reduced

SHARES = np.array([0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85])
"""Values of rho, equally likely a priori."""
LEAST_TEXTS = 3
MEDIAN_OF_SQUARES = 0.4549
"""Median of the square of a standard normal variable."""
PRIOR_PLACES = 30.0
"""Pseudo-count of the prior that objects are spread like all vectors."""


def meant_by(
    name: str, text_vectors: Mapping[str, Array], object_ids: Index, existence: Array, looks: Appearances, mapped: float
) -> Array:
    """(O,) probabilities that each of O objects matches ``name``, rather than another name or none.

    An object has one of the names with prior probability ``mapped``, uniform over the names. Raises InputError.
    """
    names = sorted(text_vectors)
    axes = _directions([text_vectors[own] for own in names], looks)
    log_ratios = _log_ratios(axes, object_ids, looks)  # (S, O, N)
    joint = np.concatenate(
        [np.full((*log_ratios.shape[:2], 1), np.log1p(-mapped)), log_ratios + np.log(mapped / len(names))], axis=2
    )
    evidence = finite_log_sum_exp(joint)  # (S, O)
    shares = evidence @ np.clip(np.nan_to_num(existence), 0.0, 1.0)
    weights = np.exp(shares - finite_log_sum_exp(shares))
    posterior = np.exp(joint - evidence[..., None])
    return np.asarray(weights @ posterior[:, :, 1 + names.index(name)])


def _directions(texts: list[Array], looks: Appearances) -> Array:
    """(N, F) unit vectors from the mean of the text vectors to each. Raises InputError."""
    if len(texts) < LEAST_TEXTS:
        raise InputError(
            f"there are {len(texts)} named text vectors; give {LEAST_TEXTS} at least, of other things too, for what a"
            " name means is told from others"
        )
    unit = np.array([looks.vector(text) for text in texts])
    axes = reduced(unit - unit.mean(axis=0), unit.shape[1])
    if np.isnan(axes).any():
        raise InputError("the text vectors are all the same; give those of different names")
    return axes


def _log_ratios(axes: Array, object_ids: Index, looks: Appearances) -> Array:
    """(S, O, N) log density ratios of the objects' projections on each name's direction: that name against none."""
    background = looks.background
    found = np.zeros((len(SHARES), len(object_ids), len(axes)))
    rows = [row for row, number in enumerate(object_ids.tolist()) if number in looks.records]
    if not rows:
        return found
    directions = [looks.records[int(object_ids[row])].mean_direction(looks.usual) for row in rows]
    places = (np.array([mean for mean, _ in directions]) - background.centre) @ axes.T  # (O, N)
    variances = _unmeant(places, looks.seen.variances(axes))
    variances = variances + np.array([error for _, error in directions])[:, None] / background.dimensions
    between = float(np.exp(looks.usual) @ (1.0 - looks.model.within)) * background.spread
    shifts = SHARES[:, None, None] * np.sqrt(between)
    found[:, rows] = (places * shifts - 0.5 * shifts**2) / variances
    return found


def _unmeant(places: Array, along: Array) -> Array:
    """(N,) variances of the (O, N) projections of objects with other names, from those of all vectors ``along``.

    Most objects do not have a given name, so the median is a robust estimate of the scale.
    """
    median = float(np.median(places**2 / along)) / MEDIAN_OF_SQUARES
    return np.asarray(along * (places.size * median + PRIOR_PLACES) / (places.size + PRIOR_PLACES))
