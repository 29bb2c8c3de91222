"""Label evidence recomputed after detections of long ago are reassigned to other objects."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.semantics.interface import LogPriorOf
from semantic_slam.inference.semantics.new_words import BoxModels
from semantic_slam.inference.semantics.told_words import ToldBox, ToldWords
from semantic_slam.inference.states.lineage import Reassigned


def retold_words(
    models: BoxModels,
    told: Mapping[int, ToldWords],
    changes: Sequence[Reassigned],
    log_prior_of: LogPriorOf,
    log_ratios: Array,
) -> dict[int, ToldWords]:
    """The label record of each object after ``changes``, each box with its original viewpoint.

    ``log_ratios`` (C,) are those of the classes of new objects, see :class:`NewClasses`.
    """
    moved = {(keyframe, number): now for keyframe, number, now, _ in changes}
    touched = {number for _, _, *both in changes for number in both}
    boxes = defaultdict[int, list[ToldBox]](list)
    for number in sorted(touched & told.keys()):
        for box in told[number].boxes:
            boxes[moved.get(box.detection, number)].append(box)
    numbers = sorted(boxes)
    after = {number: own for number, own in told.items() if number not in touched}
    for number, prior in zip(numbers, log_prior_of(numbers), strict=True):
        ratios = told[number].log_ratios if number in told else log_ratios
        after[number] = _told(models, boxes[number], prior, ratios)
    return after


def _told(models: BoxModels, boxes: Sequence[ToldBox], log_prior: Array, log_ratios: Array) -> ToldWords:
    """The label record of the boxes of one object in sequence; ``log_prior`` (C,) of its class."""
    first, *later = sorted(boxes, key=lambda box: box.detection)
    told = models.weighed(first, None, None, log_prior, log_ratios, models.labels.drawn(first.view)).told
    for box in later:
        told = models.weighed(box, None, told, log_prior, log_ratios, models.labels.drawn(box.view)).told
    return told
