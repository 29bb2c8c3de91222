"""Evidence of appearance vectors recomputed after detections of long ago are reassigned to other objects."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.semantics.told_looks import Look, views_of
from semantic_slam.inference.states.lineage import Reassigned
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel, EmbeddingRecord


def retold_looks(
    model: EmbeddingModel, views: Mapping[int, ObjectViews], changes: Sequence[Reassigned]
) -> tuple[float, dict[int, ObjectViews]]:
    """Log evidence ratio of all vectors with ``changes`` to those without, and the records with them.

    Both sides are weighed anew, each look from its original viewpoint and against its original background. What the
    objects without changes tell of the settings is taken as of now.
    """
    moved = {(keyframe, number): now for keyframe, number, now, _ in changes}
    touched = {number for _, _, *both in changes for number in both}
    untouched = {number: own for number, own in views.items() if number not in touched}
    before = {number: own.looks for number, own in views.items() if number in touched}
    after = defaultdict[int, list[Look]](list)
    for number, looks in before.items():
        for look in looks:
            after[moved.get(look.detection, number)].append(look)
    told = [own.appearance.told_settings for _, own in sorted(untouched.items()) if own.appearance is not None]
    others = np.sum([np.zeros(len(model.within)), *told], axis=0)
    log_before, _ = _weighed(model, before, others)
    log_after, records = _weighed(model, after, others)
    retold = {
        number: views_of(record, tuple(sorted(after[number], key=lambda look: look.detection)))
        for number, record in records.items()
    }
    return log_after - log_before, untouched | retold


def _weighed(
    model: EmbeddingModel, looks: Mapping[int, Sequence[Look]], others: Array
) -> tuple[float, dict[int, EmbeddingRecord]]:
    """Log evidence of the looks of each object, in the order in which they were taken, and the records after them.

    ``others`` (R,): evidence of all other objects on the settings.
    """
    each = [(look.detection, number, look) for number, own in looks.items() for look in own]
    records, total = dict[int, EmbeddingRecord](), 0.0
    for _, number, look in sorted(each, key=lambda own: own[:2]):
        record = records.get(number, model.start())
        told = [own.told_settings for other, own in sorted(records.items()) if other != number]
        usual = model.usual(np.sum([others, *told], axis=0))
        ratios = record.log_ratios(look.vector, look.background, look.place)[:, 0]
        total += model.evidence(record, ratios, usual)
        records[number] = record.after(look.vector, ratios, usual, look.background, look.place)
    return total, records
