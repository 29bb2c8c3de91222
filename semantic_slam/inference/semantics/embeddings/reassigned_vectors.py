"""Evidence of appearance vectors recomputed after detections of long ago are reassigned to other objects."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.semantics.embeddings.appearance_views import AppearanceView, record_of_views
from semantic_slam.inference.states.lineage import Reassigned
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel, EmbeddingRecord


def reassigned_vectors(
    model: EmbeddingModel, views: Mapping[int, ObjectViews], changes: Sequence[Reassigned]
) -> tuple[float, dict[int, ObjectViews]]:
    """Log evidence ratio of all vectors with ``changes`` to those without, and the records with them.

    Both sides are weighed anew, each view from its original viewpoint and against its original background. What the
    objects without changes tell of the settings is taken as of now.
    """
    moved = {(keyframe, number): now for keyframe, number, now, _ in changes}
    touched = {number for _, _, *both in changes for number in both}
    untouched = {number: own for number, own in views.items() if number not in touched}
    before = {number: own.appearance_views for number, own in views.items() if number in touched}
    after = defaultdict[int, list[AppearanceView]](list)
    for number, seen in before.items():
        for view in seen:
            after[moved.get(view.detection, number)].append(view)
    told = [own.appearance.told_settings for _, own in sorted(untouched.items()) if own.appearance is not None]
    others = np.sum([np.zeros(len(model.within)), *told], axis=0)
    log_before, _ = _weighed(model, before, others)
    log_after, records = _weighed(model, after, others)
    reassigned = {
        number: record_of_views(record, tuple(sorted(after[number], key=lambda view: view.detection)))
        for number, record in records.items()
    }
    return log_after - log_before, untouched | reassigned


def _weighed(
    model: EmbeddingModel, views: Mapping[int, Sequence[AppearanceView]], others: Array
) -> tuple[float, dict[int, EmbeddingRecord]]:
    """Log evidence of the views of each object, in the order in which they were taken, and the records after them.

    ``others`` (R,): evidence of all other objects on the settings.
    """
    each = [(view.detection, number, view) for number, own in views.items() for view in own]
    records, total = dict[int, EmbeddingRecord](), 0.0
    for _, number, view in sorted(each, key=lambda own: own[:2]):
        record = records.get(number, model.start())
        told = [own.told_settings for other, own in sorted(records.items()) if other != number]
        usual = model.usual(np.sum([others, *told], axis=0))
        ratios = record.log_ratios(view.vector, view.background, view.place)[:, 0]
        total += model.evidence(record, ratios, usual)
        records[number] = record.after(view.vector, ratios, usual, view.background, view.place)
    return total, records
