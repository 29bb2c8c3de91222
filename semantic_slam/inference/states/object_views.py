"""Semantic records of objects: the class and descriptor evidence of an object's views in one hypothesis."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.view_coverage import NO_VIEWS, ViewCoverage
from semantic_slam.inference.states.yaw import Yaw

if TYPE_CHECKING:
    from semantic_slam.inference.states.heading_mixture import HeadingMixture
    from semantic_slam.viewpoint.embeddings.model import EmbeddingRecord


UNCERTAIN_RAD = 0.2
"""Sigma of the viewing direction above which a linearised factor of the feature is not accurate enough."""


@dataclass(frozen=True, kw_only=True)
class DescriptorRecord:
    """Descriptor belief of one object from its views; keyframes without a view of it hardly change it."""

    mean: Array  # (L,)
    variance: Array  # (L,)
    direction_sigma_rad: float  # of the newest view's azimuth
    entering: tuple[tuple[int, Any], ...]  # keyframe and detection of views whose factors enter with this record
    heading_rad: float | None = None  # of the object, if estimated from its views and not stated by a map

    @property
    def is_bent(self) -> bool:
        """Whether the entering factors have to be nonlinear, as the viewing direction is uncertain."""
        return self.direction_sigma_rad > UNCERTAIN_RAD


@dataclass(frozen=True)
class HeadingRecord:
    """Record of an object whose heading no map states: a mixture over descriptor and heading."""

    modes: "HeadingMixture"
    pending: tuple[tuple[int, Any], ...]  # keyframe and detection of the views that have no factors yet


@dataclass(frozen=True, kw_only=True)
class ObjectViews:
    """The semantic record of one object in one hypothesis; C classes."""

    log_likelihood: Array  # (C,) log p(z_1:k | c) of its views, marginalised over trajectories, + log_ratios
    mutual_information: float  # nats, between class and the network's weights at the newest view
    newest: Array | None = None  # (C,) log p(z_k | c, z_1:k-1), where views are correlated; else None
    coverage: ViewCoverage = NO_VIEWS  # whether the class models were fitted on such views
    recent: tuple[Any, ...] = ()  # views with which later ones are correlated, oldest first
    log_dropped: Array | None = None  # (C,) part of log_likelihood of views that are no longer in ``recent``
    dropped: int = 0  # number of those views
    correction: Correction | None = None  # of the object's pose
    yaw: Yaw | None = None  # of an object in space, by its views; None: its Gaussian has it
    descriptor: DescriptorRecord | None = None  # with a learned latent space
    headings: HeadingRecord | None = None
    appearance: "EmbeddingRecord | None" = None  # of its appearance vectors; None: there were none
    appearance_views: tuple[Any, ...] = ()  # the views with vectors, oldest first, where they may be reassigned later
    log_ratios: Array | None = None  # (C,) log ratio of its class prior at birth to that before the run; None: equal


def coverage_of(views: ObjectViews | None) -> ViewCoverage:
    """The coverage in a record; ``NO_VIEWS`` without a record."""
    return NO_VIEWS if views is None else views.coverage


def appearance_of(views: ObjectViews | None) -> "EmbeddingRecord | None":
    """The appearance in a record; None without a record, or without a view that had a vector."""
    return None if views is None else views.appearance


def class_posterior(log_prior: Array, log_likelihood: Array) -> Array:
    """(..., C) class probabilities by Bayes' rule from log prior and log likelihood."""
    joint = log_prior + log_likelihood
    weight = np.exp(joint - joint.max(axis=-1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=-1, keepdims=True))
