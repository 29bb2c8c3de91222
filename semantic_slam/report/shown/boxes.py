"""Boxes of a keyframe, with their associated objects and detector labels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.history import UNKNOWN, associated_objects, best_index
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.report.document import Analysis

SAYS_NOTHING = frozenset({"", "object"})
"""Labels of detectors that look for anything."""


@dataclass(frozen=True)
class BoxView:
    """One detection; edges in per cent of the picture."""

    left: float
    top: float
    width: float
    height: float
    text: str
    colour: str
    verdict: str  # right, wrong or unknown
    label: str  # the detector's label and score, "" where it has none

    @property
    def places(self) -> str:
        """CSS classes that keep its texts inside the picture."""
        inside = "inside " if self.top + self.height > 93.0 else ""
        under = "under " if self.top < 5.0 else ""
        return inside + under + ("leftwards" if self.left > 60.0 else "")


def detection_text(measured: SemanticMeasurements, row: int) -> str:
    """``tv 0.62`` as the detector says it; "" where it says nothing of what a detection is."""
    label, score = measured.labels[row], float(measured.scores[row])
    if label in SAYS_NOTHING:
        return ""
    return f"{label} {score:.2f}" if np.isfinite(score) else label


def box_views(analysis: Analysis, row: int, size: tuple[int, int], colours: list[str]) -> list[BoxView]:
    """The boxes of the ``row``-th belief in a picture of that size (width, height)."""
    belief = analysis.record.beliefs[row]
    objects = associated_objects(belief)[best_index(belief)]
    verdicts = [_verdict(analysis, row, detection, int(found)) for detection, found in enumerate(objects)]
    return boxes_of(belief, analysis.record.measurements[belief.stamp_ns], size, colours, verdicts)


def boxes_of(
    belief: HybridBelief,
    measured: SemanticMeasurements,
    size: tuple[int, int],
    colours: list[str],
    verdicts: Sequence[tuple[str, str]] = (),
) -> list[BoxView]:
    """The boxes of a belief's keyframe; ``verdicts`` on what the D detections are taken for, with a note on each."""
    places = {int(number): place for place, number in enumerate(measured.detection_ids)}
    best = best_index(belief)
    views = []
    for detection, number in enumerate(belief.detection_ids):
        if int(number) in places:
            place = places[int(number)]
            box = np.clip(measured.boxes[place], 0, size * 2)
            text, colour = _text(belief, int(belief.associations[best, detection]), colours)
            verdict, note = verdicts[detection] if verdicts else ("unknown", "")
            left, top, right, bottom = (100.0 * box / np.array(size * 2)).round(2).tolist()
            label = detection_text(measured, place)
            views.append(BoxView(left, top, right - left, bottom - top, text + note, colour, verdict, label))
    return views


def _text(belief: HybridBelief, place: int, colours: list[str]) -> tuple[str, str]:
    """``object class probability`` as believed at that keyframe, and the colour of the class."""
    if place < 0:
        return "clutter", "#5b6b7a"
    probabilities = belief.class_probabilities[place]
    if not probabilities.size:
        return str(belief.object_ids[place]), "#5b6b7a"
    best = int(np.argmax(probabilities))
    return f"{belief.object_ids[place]} {belief.class_names[best]} {probabilities[best]:.2f}", colours[best]


def _verdict(analysis: Analysis, row: int, detection: int, found: int) -> tuple[str, str]:
    if analysis.evaluation is None:
        return "unknown", ""
    true = int(analysis.evaluation.true_associations[row][detection])
    if true == UNKNOWN:
        return "unknown", ""
    if true == found:
        return "right", ""
    return "wrong", f" (is {true})" if true >= 0 else " (is not on the map)" if true < -1 else " (is clutter)"
