"""Common interface of the methods that fuse the views of a track into a class posterior."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.perception.uncertainty import sample_covariance


@dataclass(frozen=True)
class Scores:
    """One semantic measurement: n dropout passes of F components, and their Gaussian approximation (Eq. 3.30)."""

    samples: Array  # (n, F)
    mean: Array  # (F,) mu_z
    covariance: Array  # (F, F) Sigma_z; may be singular

    @classmethod
    def of(cls, samples: Array) -> "Scores":
        """Scores with the moments of the (n, F) samples; the covariance of a single one is zero."""
        return cls(samples, samples.mean(axis=0), sample_covariance(samples))


@dataclass(frozen=True)
class View:
    """A measurement with the camera location under each of P tracks."""

    locations_m: Array  # (P, 2) camera relative to the object, in the object's frame
    scores: Scores


class SequentialClassifier(ABC):
    """Recursive class posterior of one object along each of P tracks; C classes, natural logarithms.

    ``log_posteriors``: (P, C), normalised over the classes of each track.
    ``log_evidence``: (P,) log p(z_0:k | track), as the product of the method's own predictions.
    ``dropped``: views that have left the window.
    """

    def __init__(self, log_prior: Array, num_tracks: int) -> None:
        self.log_prior = normalised(np.asarray(log_prior, dtype=np.float64))  # (C,)
        self.log_posteriors = np.tile(self.log_prior, (num_tracks, 1))
        self.log_evidence = np.zeros(num_tracks)
        self.dropped = 0

    @property
    def num_tracks(self) -> int:
        """Number of tracks P."""
        return len(self.log_evidence)

    @abstractmethod
    def update(self, view: View) -> Array:
        """Add a view; returns the (C,) log posterior, averaged evenly over the tracks (Eq. 3.20)."""

    @abstractmethod
    def empty(self, num_tracks: int) -> Self:
        """New classifier with these settings for ``num_tracks`` tracks, without views."""

    def replace(self, rows: Index, other: Self, source: Index) -> None:
        """Replace the tracks at ``rows`` by tracks ``source`` of ``other`` (or of itself), which has the same views."""
        self.log_posteriors[rows] = other.log_posteriors[source]
        self.log_evidence[rows] = other.log_evidence[source]

    def _weigh(self, log_likelihoods: Array) -> Array:
        """Bayes' rule for (P, n, C) likelihoods of n equally weighted samples of one view (Eqs. 3.24-3.27).

        Normalised sample by sample, then averaged; returns what ``update`` returns.
        """
        joint = self.log_posteriors[:, None, :] + log_likelihoods
        totals = log_sum_exp(joint, axis=-1)  # (P, n), -log eta of Eq. 3.26
        count = np.log(log_likelihoods.shape[1])
        self.log_posteriors = normalised(log_sum_exp(joint - totals[..., None], axis=1))
        self.log_evidence = self.log_evidence + log_sum_exp(totals, axis=-1) - count
        return averaged(self.log_posteriors)


def normalised(log_weights: Array) -> Array:
    """(..., C) log weights normalised over the last axis."""
    return np.asarray(log_weights - log_sum_exp(log_weights, axis=-1, keepdims=True))


def averaged(log_posteriors: Array, log_weights: Array | None = None) -> Array:
    """(C,) log of the average of (P, C) posteriors, with (P,) normalised log weights or evenly."""
    weights = -np.log(len(log_posteriors)) if log_weights is None else log_weights[:, None]
    return np.asarray(log_sum_exp(log_posteriors + weights, axis=0))
