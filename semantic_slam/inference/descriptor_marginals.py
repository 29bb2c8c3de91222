"""What one hypothesis knows of the objects' descriptors."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import descriptor_key
from semantic_slam.inference.world.objects import ReportedObjects


@dataclass(frozen=True)
class DescriptorMarginals:
    """Descriptor marginals of O objects in the order of the report; L is 0 without a learned latent space."""

    mean: Array  # (O, L)
    variance: Array  # (O, L) NaN where the component has no such object


def descriptor_marginals(component: Component, reported: ReportedObjects) -> DescriptorMarginals:
    """Means as the smoother has them now, variances of the newest view, and the prior where nothing was seen."""
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
