"""The class models of a run, as its configuration names them."""

from dataclasses import dataclass
from typing import Self

from semantic_slam.class_models.detector import load_label_model
from semantic_slam.class_models.embedding import load_embedding_model
from semantic_slam.class_models.file_digest import check_digest
from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.inference.building.views import tempering
from semantic_slam.latent.model import DescriptorModel
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.model import ViewpointModel
from semantic_slam.viewpoint.outliers import OutlierScores


@dataclass(frozen=True, kw_only=True)
class RunModels:
    """The class models of a run; those that the configured kind does not have are None."""

    viewpoint: ViewpointModel | None  # P(z | c, viewpoint)
    descriptors: DescriptorModel | None  # P(f | viewpoint, e), e being a descriptor in a learned latent space
    labels: LabelModel | None  # P(label | c) of a detector
    embeddings: EmbeddingModel | None  # model of appearance vectors
    outliers: OutlierScores | None  # density of outlier scores
    tempering: float  # number of views that carry as much information as one independent view

    @classmethod
    def load(cls, settings: SemanticModelConfiguration, bag_sha256: str) -> Self:
        """Load the models for a run on the bag with that digest, "" where there is no bag. Raises InputError."""
        check_digest(settings)
        viewpoint = load_model(settings)
        return cls(
            viewpoint=viewpoint,
            descriptors=load_latent_model(settings),
            labels=load_label_model(settings, bag_sha256),
            embeddings=load_embedding_model(settings, bag_sha256),
            outliers=_outliers(viewpoint, settings.outlier_share),
            tempering=tempering(settings),
        )


def _outliers(model: ViewpointModel | None, share: float) -> OutlierScores | None:
    """The outlier density that is mixed into view likelihoods; None: no view is an outlier."""
    return OutlierScores.of(model, share) if model is not None and share else None
