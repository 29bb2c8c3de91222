"""Evidence that two maps are of one place under an alignment, against maps that have nothing in common.

Let q and r be the shares of what there is that the first map, and the second one, hold. They are unknown, since nobody
may have looked everywhere. Where both maps reach, an object of the first one is in the second with probability 0.95 r,
and other objects of the second one come at r (0.05 + (1 - q) / q) times the density of the first map's. In a different
place, and where only the second map reaches, they come at r / q times that density, and what the first map holds is
absent at no cost. The alignment is integrated out about its estimate (Laplace's method), with an even density over all
ways in which the maps may meet.
"""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.association.murty import KBest
from semantic_slam.maps.correspondence import Correspondence, likeliest
from semantic_slam.maps.landmarks import Landmarks
from semantic_slam.maps.likelihood import GONE_SHARE, REPLACED_SHARE, log_new_density, pairs, surroundings

NODES = 24
"""Nodes of the Gauss-Legendre quadrature over each map's unknown share."""


@dataclass(frozen=True, kw_only=True)
class _Shares:
    """Q pairs of shares of what there is that the two maps hold, even between 0 and 1."""

    ours: Array  # (Q,)
    theirs: Array  # (Q,)
    log_weights: Array  # (Q,)

    @classmethod
    def even(cls) -> "_Shares":
        """Nodes and log weights of the quadrature."""
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        ours, theirs = (own.ravel() for own in np.meshgrid(0.5 * (nodes + 1.0), 0.5 * (nodes + 1.0), indexing="ij"))
        return cls(ours=ours, theirs=theirs, log_weights=np.log(0.25 * np.outer(weights, weights)).ravel())

    def log_mean(self, log_values: Array) -> float:
        """Log of the mean of values (Q,)."""
        return float(np.logaddexp.reduce(self.log_weights + log_values))


def log_odds_of_one_place(old: Landmarks, new: Landmarks, log_absent: Array, found: Correspondence) -> float:
    """Log likelihood ratio of one place, aligned near ``found``, to different places."""
    alignment, frames, shares = found.alignment, old.frames, _Shares.even()
    known = replace(alignment, covariance=np.zeros_like(alignment.covariance))
    likelihoods = pairs(old, new, known, found.vacated)
    best = likeliest(np.logaddexp(likelihoods.log_same, likelihoods.log_displaced), log_absent)
    reached = _within(new, frames.moved(frames.inverse(alignment.T_old_new), old.states))
    mapped = _within(old, frames.moved(alignment.T_old_new, new.states))
    stated = np.exp(likelihoods.log_unmatched - log_new_density(old))[:, None] * GONE_SHARE
    here = np.where(mapped[:, None], GONE_SHARE - 1.0, 0.0) + 1.0 / shares.ours + stated - GONE_SHARE
    log_new = _log_of_new(new, shares.theirs * here / stated)
    log_elsewhere = _log_of_new(new, shares.theirs / shares.ours / stated)
    existing = old.existence * reached
    absent = np.log(1.0 - (1.0 - GONE_SHARE) * existing[:, None] * shares.theirs) - log_absent[:, None]
    log_here = _log_sum(best, absent, log_new, np.log(shares.theirs))
    replacing = REPLACED_SHARE if old.classes.shape[1] > 1 else 0.0  # only another class tells a replacement
    fewer = (1.0 - GONE_SHARE) * existing.sum() - replacing * found.vacated @ reached
    size = np.exp(log_new_density(old)) / GONE_SHARE * _size(new)
    elsewhere = log_elsewhere.sum(axis=0) - shares.theirs / shares.ours * size
    one = log_here - shares.theirs / shares.ours * size + shares.theirs * fewer
    return shares.log_mean(one) - shares.log_mean(elsewhere) + _log_share(old, new, alignment.covariance)


def _log_sum(best: KBest, absent: Array, log_new: Array, log_seen: Array) -> Array:
    """(Q,) log sum over assignments, whose objects without counterpart have the weights (n, Q) and (m, Q)."""
    count = len(log_new)
    is_absent = best.columns >= count
    is_new = np.ones((len(best.costs), count))
    rows, places = np.nonzero(~is_absent)
    is_new[rows, best.columns[rows, places]] = 0.0
    matched = (~is_absent).sum(axis=1)[:, None] * log_seen
    return np.asarray(
        np.logaddexp.reduce(matched + is_absent @ absent + is_new @ log_new - best.costs[:, None], axis=0)
    )


def _log_of_new(new: Landmarks, ratios: Array) -> Array:
    """(m, Q) log weights of new objects without counterpart whose density is ``ratios`` times the stated one."""
    existence = new.existence[:, None]
    return np.asarray(np.log(existence * ratios + 1.0 - existence))


def _log_share(old: Landmarks, new: Landmarks, covariance: Array) -> float:
    """Log share of all ways in which the maps may meet that an alignment's ``covariance`` covers."""
    ways = max(_size(old), _size(new)) * 2.0 * np.pi
    return float(0.5 * np.linalg.slogdet(2.0 * np.pi * covariance)[1] - np.log(ways))


def _size(known: Landmarks) -> float:
    """Area [m^2] of a map with its surroundings; volume [m^3] in space."""
    low, high = surroundings(known)
    return float(np.prod(high - low))


def _within(known: Landmarks, states: Array) -> Flags:
    """(k,) which of k states in a map's frame lie within its surroundings."""
    low, high = surroundings(known)
    places = states[:, : known.frames.num_axes]
    return np.asarray(((places >= low) & (places <= high)).all(axis=1))
