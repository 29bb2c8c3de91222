"""Which objects is a text about, by its vector? With a calibrated probability, for cosines of texts mean nothing.

Vectors of texts and of pictures lie apart, so that texts are compared with each other first: what a name means is the
direction from the mean of all named texts. Along that direction the objects' mean directions spread as those of all
vectors do, or about a shift: that of objects of that name, a share rho of the spread between objects. How large rho is
nobody knows; it is inferred from all objects and names at once, by the evidence that each object has one of the names,
or none. A name is compared along its own direction with the background alone, which is exact for features of its own
against a common reference (Baggenstoss 2003).
"""

from collections.abc import Mapping

import numpy as np

from semantic_slam.answers.appearances import Appearances
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.viewpoint.embeddings.vectors import reduced

SHARES = np.array([0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85])
"""rho, as likely before anything was seen."""
LEAST_TEXTS = 3
MEDIAN_OF_SQUARES = 0.4549
"""Median of the square of a standard normal variable."""
PRIOR_PLACES = 30.0
"""Places that count for objects to spread as all vectors do."""


def meant_by(
    name: str, text_vectors: Mapping[str, Array], object_ids: Index, existence: Array, looks: Appearances, mapped: float
) -> Array:
    """(O,) probabilities that O objects are what ``name`` means, rather than another name or none of them.

    An object has one of the names with the probability ``mapped``, each alike. Raises InputError.
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
    """(N, F) unit vectors from the mean of the texts to each. Raises InputError."""
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
    """(S, O, N) log densities of the objects' places along each direction if they have that name, to those if none."""
    background = looks.background
    found = np.zeros((len(SHARES), len(object_ids), len(axes)))
    rows = [row for row, number in enumerate(object_ids.tolist()) if number in looks.records]
    if not rows:
        return found
    told = [looks.records[int(object_ids[row])].mean_direction() for row in rows]
    places = (np.array([mean for mean, _ in told]) - background.centre) @ axes.T  # (O, N)
    variances = _unmeant(places, looks.seen.variances(axes))
    variances = variances + np.array([error for _, error in told])[:, None] / background.dimensions
    between = float(np.exp(looks.usual) @ (1.0 - looks.model.within)) * background.spread
    shifts = SHARES[:, None, None] * np.sqrt(between)
    found[:, rows] = (places * shifts - 0.5 * shifts**2) / variances
    return found


def _unmeant(places: Array, along: Array) -> Array:
    """(N,) variances of (O, N) places of objects that have other names, from those of all vectors ``along``.

    Most objects do not have a name, so that the median tells the scale, whatever the others do.
    """
    median = float(np.median(places**2 / along)) / MEDIAN_OF_SQUARES
    return np.asarray(along * (places.size * median + PRIOR_PLACES) / (places.size + PRIOR_PLACES))
