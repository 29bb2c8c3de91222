"""Construction of a run's sensing: its state spaces and the matching observation model."""

from semantic_slam.configuration import Configuration
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.building.run_models import RunModels
from semantic_slam.inference.building.views import views_are_factors
from semantic_slam.inference.world.sensing import Sensing, SensingBuilder, SensingSettings
from semantic_slam.registry import OBSERVATIONS, SPATIAL_OBSERVATIONS
from semantic_slam.viewpoint.model import feature_names


def sensing_of(configuration: Configuration, models: RunModels) -> Sensing:
    """The sensing of a run; the observation model has the class model if views enter as factors. Raises InputError."""
    explained = models.viewpoint or models.descriptors
    registry = SPATIAL_OBSERVATIONS if configuration.is_spatial else OBSERVATIONS
    build: SensingBuilder = registry.load(configuration.observation)
    return build(
        SensingSettings(
            configuration=configuration,
            tracks_objects=strategy_of(configuration).tracks_objects,
            class_model=models.viewpoint if views_are_factors(configuration) else None,
            tempering=models.tempering,
            outliers=models.outliers,
            num_features=explained.num_features if explained is not None else 0,
            feature_names=feature_names(models.viewpoint) if models.viewpoint is not None else (),
            labels=models.labels.labels if models.labels is not None else (),
            vector_dimensions=models.embeddings.dimensions if models.embeddings is not None else 0,
        )
    )
