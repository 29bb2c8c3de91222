"""Evidence section of the report: each object's views, their contributions in nats, and its rival classes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.answers.explain.explanation import Explanation, explanations
from semantic_slam.answers.explain.sentences import sentences
from semantic_slam.answers.explain.tables import rivals_table, views_table
from semantic_slam.answers.explain.text import replay_line
from semantic_slam.report.document import Analysis
from semantic_slam.report.shown.crops import BestView
from semantic_slam.report.shown.frames import CropView
from semantic_slam.report.shown.objects import object_label

MOST_OBJECTS = 60
"""Objects that are explained: those that most detections are of."""
MOST_PICTURES = 12
"""Views of an object that are shown: those that said most."""


@dataclass(frozen=True)
class ViewRow:
    """One row of an object's account."""

    crop: CropView | None
    label: str  # what the picture is of
    cells: list[str]


@dataclass(frozen=True)
class EvidenceView:
    """One object's account."""

    number: int
    label: str
    sentences: list[str]
    header: list[str]
    rows: list[ViewRow]
    rivals: list[list[str]]  # header and rows
    replayed: str

    @property
    def has_crops(self) -> bool:
        """Whether there is a picture of any view."""
        return any(row.crop for row in self.rows)


def evidence_of(analysis: Analysis, belief_bag: Path) -> list[Explanation]:
    """Explanations of the objects with most detections, by increasing id. Raises InputError."""
    last = analysis.record.beliefs[-1].object_ids.tolist()
    seen = [number for number in last if analysis.detection_counts[number]]
    most = sorted(seen, key=lambda number: (-analysis.detection_counts[number], number))[:MOST_OBJECTS]
    return explanations(belief_bag, sorted(most))


def shown_views(analysis: Analysis, explained: Sequence[Explanation]) -> list[BestView]:
    """The views of which pictures are shown."""
    return [view for own in explained for view in _views(analysis, own)]


def _views(analysis: Analysis, explanation: Explanation) -> list[BestView]:
    own, rows = explanation.histories[0], _rows(analysis)
    chosen = np.argsort(-np.abs(np.nan_to_num(explanation.alone(own))), kind="stable")[:MOST_PICTURES]
    found = []
    for view in (own.views[place] for place in sorted(chosen.tolist())):
        row = rows[view.keyframe]
        belief = analysis.record.beliefs[row]
        measured = analysis.record.measurements.get(belief.stamp_ns)
        if measured is None:
            continue
        places = np.flatnonzero(measured.detection_ids == belief.detection_ids[view.detection])
        if len(places) and np.isfinite(measured.boxes[places[0]]).all():
            found.append(BestView(explanation.object_id, row, measured.boxes[places[0]], f"keyframe {view.keyframe}"))
    return found


def _rows(analysis: Analysis) -> dict[int, int]:
    """Keyframe -> place of its belief."""
    return {belief.keyframe: row for row, belief in enumerate(analysis.record.beliefs)}


def evidence_views(
    analysis: Analysis, explained: Sequence[Explanation], crops: Mapping[tuple[int, int], CropView]
) -> list[EvidenceView]:
    """Accounts with the pictures of their views, of which ``crops`` has some by object and place of the belief."""
    return [_view(analysis, own, crops) for own in explained]


def _view(analysis: Analysis, explanation: Explanation, crops: Mapping[tuple[int, int], CropView]) -> EvidenceView:
    own, rows = explanation.histories[0], _rows(analysis)
    header, *table = views_table(explanation, own)
    label = object_label(explanation.belief, explanation.row)
    of_rows = {str(view.keyframe): crops.get((explanation.object_id, rows[view.keyframe])) for view in own.views}
    return EvidenceView(
        number=explanation.object_id,
        label=label,
        sentences=sentences(explanation, own),
        header=header,
        rows=[ViewRow(crop=of_rows.get(cells[0]), label=label, cells=cells) for cells in table],
        rivals=rivals_table(explanation, own),
        replayed=replay_line(explanation),
    )
