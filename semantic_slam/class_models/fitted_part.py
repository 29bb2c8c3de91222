"""Which part of the class models a file of ``semantic_slam fit --from-run`` belongs to: labels, or vectors."""

from pathlib import Path

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.model_files import kind_of
from semantic_slam.viewpoint.embeddings.store import FORMAT


def is_of_vectors(settings: SemanticModelConfiguration) -> bool:
    """Whether ``semantic_model.path`` is of the vectors' model: where there are labels, too, the file itself says.

    False where no file is named. Raises InputError for an unknown kind of class models.
    """
    kind = class_model_kind(settings)
    if not settings.path or kind.embeddings is None:
        return False
    return kind.labels is None or kind_of(Path(settings.path)) == FORMAT.kind
