"""Label evidence recomputed after detections of long ago are reassigned to other objects."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.semantics.detector.label_records import LabelEvidence, LabelledBox
from semantic_slam.inference.semantics.detector.new_words import BoxModels
from semantic_slam.inference.semantics.interface import LogPriorOf
from semantic_slam.inference.states.lineage import Reassigned


def reassigned_labels(
    models: BoxModels,
    before: Mapping[int, LabelEvidence],
    changes: Sequence[Reassigned],
    log_prior_of: LogPriorOf,
    log_ratios: Array,
) -> dict[int, LabelEvidence]:
    """The label evidence of each object after ``changes``, each box with its original viewpoint.

    ``log_ratios`` (C,) are those of the classes of new objects, see :class:`NewClasses`.
    """
    moved = {(keyframe, number): now for keyframe, number, now, _ in changes}
    touched = {number for _, _, *both in changes for number in both}
    boxes = defaultdict[int, list[LabelledBox]](list)
    for number in sorted(touched & before.keys()):
        for box in before[number].boxes:
            boxes[moved.get(box.detection, number)].append(box)
    numbers = sorted(boxes)
    after = {number: own for number, own in before.items() if number not in touched}
    for number, prior in zip(numbers, log_prior_of(numbers), strict=True):
        ratios = before[number].log_ratios if number in before else log_ratios
        after[number] = _evidence_of(models, boxes[number], prior, ratios)
    return after


def _evidence_of(models: BoxModels, boxes: Sequence[LabelledBox], log_prior: Array, log_ratios: Array) -> LabelEvidence:
    """The label evidence of the boxes of one object in sequence; ``log_prior`` (C,) of its class."""
    first, *later = sorted(boxes, key=lambda box: box.detection)
    evidence = models.weighed(first, None, None, log_prior, log_ratios, models.labels.drawn(first.view)).evidence
    for box in later:
        drawn = models.labels.drawn(box.view)
        evidence = models.weighed(box, None, evidence, log_prior, log_ratios, drawn).evidence
    return evidence
