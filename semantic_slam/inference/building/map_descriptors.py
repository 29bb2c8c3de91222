"""Priors of the appearance of mapped objects: descriptors or appearance vectors, as the class models use them."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.inference.building.run_models import RunModels
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.latent.prior import prior_of_classes
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.latent.model import DescriptorBelief, DescriptorModel
from semantic_slam.viewpoint.embeddings.model import EmbeddingRecord


def latent_observation_of(
    models: RunModels, prior: MapPrior, objects: Sequence[ObjectEntry]
) -> LatentObservation | None:
    """The learned likelihood, with descriptor priors from the map's descriptors or else its classes.

    None without a latent space. Raises InputError.
    """
    model = models.descriptors
    if model is None:
        return None
    _check_space(prior, model.space, "semantic_model.path")
    known = {entry.object_id: prior_of_classes(model, entry.class_prior) for entry in objects}
    known |= {item.object_id: _descriptor(item, model) for item in prior.objects if len(item.descriptor)}
    return LatentObservation(model, models.tempering, known)


def appearances_of(models: RunModels, prior: MapPrior) -> dict[int, EmbeddingRecord]:
    """Object id -> appearance record from the map; {} unless vectors are evidence. Raises InputError."""
    model = models.embeddings
    if model is None:
        return {}
    _check_space(prior, model.space, "semantic_model.kind and embedding_dimensions")
    described = [item for item in prior.objects if len(item.descriptor)]
    for item in described:
        _check_length(item, model.dimensions)
    return {item.object_id: model.start(item.descriptor, float(item.descriptor_variance.sum())) for item in described}


def _descriptor(item: ObjectPrior, model: DescriptorModel) -> DescriptorBelief:
    """The descriptor belief of a mapped object. Raises InputError for a descriptor of another length."""
    _check_length(item, model.num_dimensions)
    return DescriptorBelief(item.descriptor[None], np.sqrt(item.descriptor_variance)[None])


def _check_space(prior: MapPrior, space: str, parameters: str) -> None:
    if prior.descriptor_space != space and any(len(item.descriptor) for item in prior.objects):
        raise InputError(
            f"map prior: its descriptors are of the latent space '{prior.descriptor_space}', the model's is"
            f" '{space}'; use the {parameters} that the map was made with"
        )


def _check_length(item: ObjectPrior, dimensions: int) -> None:
    if len(item.descriptor) != dimensions:
        raise InputError(
            f"map prior: object {item.object_id} has a descriptor of {len(item.descriptor)} components, the latent"
            f" space has {dimensions}; write the map anew"
        )
