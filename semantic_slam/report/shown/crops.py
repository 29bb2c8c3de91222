"""Selection of the best view of an object."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.history import Ids, best_history
from semantic_slam.geometry.arrays import Array
from semantic_slam.report.document import Analysis
from semantic_slam.report.shown.boxes import detection_text

MOST_CROPS = 60
"""Objects of which a view is shown: those that most detections are of."""
MARGIN = 0.08
"""Share of a box that is shown around it."""


@dataclass(frozen=True)
class BestView:
    """The view of an object that is cut out."""

    object_id: int
    row: int  # of the belief
    box: Array  # (4,) pixels
    text: str


def best_views(analysis: Analysis) -> list[BestView]:
    """The largest box of each object that the detector calls what the object is, else the largest of all."""
    last = analysis.record.beliefs[-1]
    names = [last.class_names[int(own.argmax())] if own.size else "" for own in last.class_probabilities]
    called = dict(zip(last.object_ids.tolist(), names, strict=True))
    best: dict[int, tuple[tuple[bool, float], BestView]] = {}
    for row, found in enumerate(best_history(analysis.record.beliefs)):
        for number, rank, view in _views(analysis, row, found, called):
            if number not in best or rank > best[number][0]:
                best[number] = rank, view
    most = sorted(best, key=lambda number: (-analysis.detection_counts[number], number))[:MOST_CROPS]
    return [best[number][1] for number in most]


def _views(
    analysis: Analysis, row: int, found: Ids | None, called: dict[int, str]
) -> list[tuple[int, tuple[bool, float], BestView]]:
    """Objects of one keyframe's detections, with how well each shows what its object is."""
    belief = analysis.record.beliefs[row]
    measured = analysis.record.measurements.get(belief.stamp_ns)
    if measured is None or found is None:
        return []
    places = {int(number): place for place, number in enumerate(measured.detection_ids)}
    views = []
    for detection, number in zip(belief.detection_ids.tolist(), found.tolist(), strict=True):
        place = places.get(detection, -1)
        if number not in called or place < 0 or not np.isfinite(measured.boxes[place]).all():
            continue
        box, label = measured.boxes[place], detection_text(measured, place)
        rank = measured.labels[place] == called[number], float(np.prod(box[2:] - box[:2]))
        text = f"keyframe {belief.keyframe}" + (f": {label}" if label else "")
        views.append((number, rank, BestView(number, row, box, text)))
    return views
