"""What runs teach of the detector whose labels, vectors, or both they went by, in one file of models."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from semantic_slam.class_models.embedding import embedding_model
from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.training.embeddings.learn import learn_embeddings, looks_of
from semantic_slam.training.embeddings.report import lines_of as lines_of_looks
from semantic_slam.training.labels.learn import RunTracks, learn
from semantic_slam.training.labels.report import lines_of
from semantic_slam.training.runs import Run
from semantic_slam.viewpoint.embeddings.store import FittedEmbeddings, save_embeddings
from semantic_slam.viewpoint.labels.store import FittedLabels, save_labels


@dataclass(frozen=True, kw_only=True)
class LearnedLabels:
    """Models of labels, with those of vectors where the runs went by both and any object has one."""

    labels: FittedLabels
    goes_by_vectors: bool

    def save(self, path: Path) -> None:
        """Write the models."""
        save_labels(self.labels, path)

    @property
    def report(self) -> dict[str, Any]:
        """What was found, by name."""
        vectors = self.labels.vectors
        return self.labels.report | ({} if vectors is None else {"vectors": vectors.report})

    @property
    def lines(self) -> list[str]:
        """The report in a few lines."""
        if self.labels.vectors is not None:
            looks = lines_of_looks(self.labels.vectors.report)
        else:
            looks = ["vectors: no object of the runs has one, so their models are as configured"]
        return [*lines_of(self.labels.report), *(looks if self.goes_by_vectors else [])]


@dataclass(frozen=True, kw_only=True)
class LearnedLooks:
    """Models of vectors alone."""

    vectors: FittedEmbeddings

    def save(self, path: Path) -> None:
        """Write the models."""
        save_embeddings(self.vectors, path)

    @property
    def report(self) -> dict[str, Any]:
        """What was found, by name."""
        return self.vectors.report

    @property
    def lines(self) -> list[str]:
        """The report in a few lines."""
        return lines_of_looks(self.vectors.report)


def learn_from(runs: Sequence[Run]) -> LearnedLabels | LearnedLooks:
    """Models for the kind of class models that the runs had, one for all. Raises InputError."""
    kind = class_model_kind(runs[0].configuration.semantic_model)
    digests, goes_by_vectors = [run.sha256 for run in runs], kind.embeddings is embedding_model
    if kind.labels is None:
        return LearnedLooks(vectors=learn_embeddings(looks_of(runs), digests))
    told = looks_of(runs) if goes_by_vectors else None
    vectors = learn_embeddings(told, digests) if told is not None and told.has_views else None
    return LearnedLabels(labels=replace(learn(RunTracks.of(runs)), vectors=vectors), goes_by_vectors=goes_by_vectors)
