"""Descriptor marginals of objects in one hypothesis: in a learned latent space, or mean directions of vectors."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import descriptor_key
from semantic_slam.inference.states.object_views import appearance_of
from semantic_slam.inference.world.objects import ReportedObjects
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel


@dataclass(frozen=True)
class DescriptorMarginals:
    """Descriptor marginals of O objects in the order of the report; L is 0 where objects have none."""

    mean: Array  # (O, L)
    variance: Array  # (O, L) NaN where the component has no such object


def descriptor_marginals(
    component: Component, reported: ReportedObjects, embeddings: EmbeddingModel | None = None
) -> DescriptorMarginals:
    """Descriptor means from the smoother and variances at the newest view; the prior for objects without views.

    With ``embeddings`` the mean directions of the objects' appearance vectors, NaN for objects without views.
    """
    if embeddings is not None:
        return _mean_directions(component, reported, embeddings)
    latent = component.smoother.semantics.latent
    if latent is None:
        none = np.zeros((len(reported.ids), 0))
        return DescriptorMarginals(none, none)
    mean = np.full((len(reported.ids), latent.num_dimensions), np.nan)
    variance = mean.copy()
    for row, number in enumerate(reported.ids):
        views = component.views.get(number)
        if views is not None and views.descriptor is not None:
            mean[row], variance[row] = views.descriptor.mean, views.descriptor.variance
            if component.smoother.has(descriptor_key(number)):
                mean[row] = component.smoother.descriptors([descriptor_key(number)])[0]
        elif number in component.object_ids:
            prior = latent.prior_of(number)
            mean[row], variance[row] = prior.mean[0], prior.sigma[0] ** 2
    return DescriptorMarginals(mean, variance)


def _mean_directions(
    component: Component, reported: ReportedObjects, embeddings: EmbeddingModel
) -> DescriptorMarginals:
    """Mean directions of appearance vectors; the expected squared error is split evenly over the components."""
    size = embeddings.dimensions
    mean, variance = np.full((2, len(reported.ids), size), np.nan)
    every = [appearance_of(component.views[number]) for number in sorted(component.views)]
    told = sum((own.told_settings for own in every if own is not None), np.zeros(len(embeddings.within)))
    for row, number in enumerate(reported.ids):
        own = appearance_of(component.views.get(number))
        if own is not None:
            mean[row], spread = own.mean_direction(embeddings.usual(told - own.told_settings))
            variance[row] = spread / size
    return DescriptorMarginals(mean, variance)
