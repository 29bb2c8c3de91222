"""What the views of an object, associated as one hypothesis has it, tell of its class."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.view_coverage import NO_VIEWS, ViewCoverage

if TYPE_CHECKING:
    from semantic_slam.inference.states.heading_mixture import HeadingMixture


UNCERTAIN_RAD = 0.2
"""Standard deviation of the direction of view from which on a linear factor of the feature would not do."""


@dataclass(frozen=True, kw_only=True)
class DescriptorRecord:
    """What the views of one object tell of its descriptor; later keyframes without it change that little."""

    mean: Array  # (L,)
    variance: Array  # (L,)
    direction_sigma_rad: float  # of the newest view's azimuth
    entering: tuple[tuple[int, Any], ...]  # keyframe and detection of the views whose factors enter with this record
    heading_rad: float | None = None  # of the object, where its views tell that and no map does

    @property
    def is_bent(self) -> bool:
        """Whether the factors that enter have to be exact."""
        return self.direction_sigma_rad > UNCERTAIN_RAD


@dataclass(frozen=True)
class HeadingRecord:
    """An object whose heading no map tells: its modes over descriptor and heading."""

    modes: "HeadingMixture"
    pending: tuple[tuple[int, Any], ...]  # keyframe and detection of the views that have no factors yet


@dataclass(frozen=True, kw_only=True)
class ObjectViews:
    """The semantic record of one object in one hypothesis; C classes."""

    log_likelihood: Array  # (C,) log p(z_1:k | c) of its semantic measurements, tracks averaged out, + log_ratios
    mutual_information: float  # nats, between class and the network's weights at the newest view
    newest: Array | None = None  # (C,) log p(z_k | c, z_1:k-1), where views change what earlier ones tell; else None
    coverage: ViewCoverage = NO_VIEWS  # which of the views the class models know
    recent: tuple[Any, ...] = ()  # views that later ones correlate with, oldest first
    log_dropped: Array | None = None  # (C,) share of log_likelihood of the views no longer in ``recent``
    dropped: int = 0  # number of those views
    correction: Correction | None = None  # of the object's pose
    descriptor: DescriptorRecord | None = None  # with a learned latent space
    headings: HeadingRecord | None = None
    log_ratios: Array | None = None  # (C,) how its class's prior differed when it was added; None: not at all


def coverage_of(views: ObjectViews | None) -> ViewCoverage:
    """What a record says of the coverage; of none, that nothing was seen."""
    return NO_VIEWS if views is None else views.coverage


def class_posterior(log_prior: Array, log_likelihood: Array) -> Array:
    """(..., C) class probabilities by Bayes' rule from log prior and log likelihood."""
    joint = log_prior + log_likelihood
    weight = np.exp(joint - joint.max(axis=-1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=-1, keepdims=True))
