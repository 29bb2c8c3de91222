"""Runs whose beliefs tell, softly, which detections show which object from where."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

from semantic_slam.class_models.embedding import embedding_model
from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration, SemanticModelConfiguration, from_dict
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import Record, json_object

SHARED = 0.5
"""Share of the smaller run's frames beyond which two runs are of the same detections."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """The record of a run, and what it was a run of."""

    record: Record
    configuration: Configuration
    bag: str  # path of the input
    sha256: str  # of the input, "" where the run names none

    @property
    def settings(self) -> SemanticModelConfiguration:
        """What was known of the detector before anything was fitted, with the labels of the run."""
        return replace(self.configuration.semantic_model, path="", path_digest="")

    def shares_views(self, other: "Run") -> bool:
        """Whether most of a run's detections are another's, too: of one bag, or of another bag made from it."""
        if self.sha256 and self.sha256 == other.sha256:
            return True
        one, two = (_views(run.record) for run in (self, other))
        return len(one & two) > SHARED * min(len(one), len(two))


def read_runs(folders: Sequence[Path]) -> list[Run]:
    """The runs in the folders that reports were written to.

    Raises InputError for one that tells nothing of labels and looks, and for runs of several kinds.
    """
    runs = [_read(folder) for folder in folders]
    kinds = {run.configuration.semantic_model.kind for run in runs}
    if len(kinds) > 1:
        raise InputError(f"the runs are of semantic_model.kind {' and '.join(sorted(kinds))}; give those of one kind")
    for (folder, run), (other, another) in combinations(zip(folders, runs, strict=True), 2):
        if run.shares_views(another):
            raise InputError(
                f"{folder} and {other}: are runs of one bag, or of a copy, whose views would count twice; leave out all"
                " but one"
            )
    return runs


def _views(record: Record) -> set[tuple[int, tuple[str, ...], bytes, bytes]]:
    """Stamp [ns], labels, scores and boxes of each frame that has detections."""
    return {
        (stamp, own.labels, own.scores.tobytes(), own.boxes.tobytes())
        for stamp, own in record.measurements.items()
        if len(own.labels)
    }


def _read(folder: Path) -> Run:
    beliefs = folder / "belief"
    if not beliefs.exists():
        raise InputError(f"{folder}: has no beliefs; give a folder that semantic_slam report --out wrote")
    record = read_record(beliefs)
    configuration = from_dict(json_object(record.run.configuration), f"{folder}: run configuration")
    kind = class_model_kind(configuration.semantic_model)
    if kind.labels is None and kind.embeddings is not embedding_model:
        raise InputError(
            f"{folder}: ran with semantic_model.kind: {configuration.semantic_model.kind}, by which labels and"
            " vectors name nothing; run the bag with --config config/detector.yaml first"
        )
    return Run(
        record=record,
        configuration=configuration,
        bag=str(json_object(record.run.source).get("path") or folder),
        sha256=record.run.source_sha256,
    )
