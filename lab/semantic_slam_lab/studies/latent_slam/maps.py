"""Maps of a room that tell poses alone, classes, or which instance stands where."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam_lab.simulation.goods import goods_class
from semantic_slam_lab.studies.ch5.models import DEFAULT, trained

SHARE_OF_PRIOR = 0.1
"""Standard deviation of the descriptor of an instance that training has seen, in those of the prior."""


def unannotated(prior: MapPrior) -> MapPrior:
    """The map prior with its poses alone."""
    return MapPrior(tuple(replace(entry, class_probabilities={}) for entry in prior.objects))


def with_classes(prior: MapPrior, instances: Mapping[int, str]) -> MapPrior:
    """Every object's class is known."""
    return MapPrior(
        tuple(
            replace(entry, class_probabilities={goods_class(instances[entry.object_id]): 1.0})
            for entry in prior.objects
        )
    )


def with_instances(prior: MapPrior, instances: Mapping[int, str]) -> MapPrior:
    """Every object's descriptor is that of its instance, where the model was trained on it; others stay unknown."""
    model = trained(DEFAULT).model
    learned = dict(zip(model.instances.names, model.instances.descriptors, strict=True))
    sigma = SHARE_OF_PRIOR * model.prior.sigma[0]
    return MapPrior(
        tuple(
            replace(entry, descriptor=np.asarray(learned[name]), descriptor_variance=sigma**2)
            if (name := instances[entry.object_id]) in learned
            else entry
            for entry in prior.objects
        ),
        model.space,
    )
