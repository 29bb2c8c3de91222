"""What is said of each true object, from its first detection to the end of the drive."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.correspondence import match_objects
from semantic_slam.evaluation.history import best_history
from semantic_slam.evaluation.record import Record
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.viewpoint.labels.model import NONE_OF_THESE
from semantic_slam_lab.simulation.detectors.detector_words import DetectorFaults

CLASSES = (*sorted(DetectorFaults().names), NONE_OF_THESE)
"""C columns of every course."""
EXISTS = 0.5
"""Existence from which on an object is said to be there."""


@dataclass(frozen=True, kw_only=True)
class Course:
    """One true object over the K keyframes from its first detection on."""

    object_id: str
    probabilities: Array  # (K, C) of CLASSES
    true_class: str

    @property
    def true_column(self) -> int:
        """Column of the true class."""
        return CLASSES.index(self.true_class)

    @property
    def true_probability(self) -> Array:
        """(K,) of the true class."""
        return np.asarray(self.probabilities[:, self.true_column])

    @property
    def is_right(self) -> bool:
        """Whether the likeliest class is the true one at the end."""
        return bool(self.probabilities[-1].argmax() == self.true_column)


@dataclass(frozen=True, kw_only=True)
class Told:
    """One detection as its detector describes it."""

    label: str
    scores: Array  # (C,) of CLASSES, NaN where not reported


Rule = Callable[[Sequence[Told]], Array]
"""(C,) class probabilities from the views of an object so far."""


class Drive:
    """A recorded run beside what is true."""

    def __init__(self, record: Record) -> None:
        assert record.truth is not None and record.truth.objects is not None
        self.record, self.truth = record, record.truth
        self.history = [np.zeros(0, dtype=int) if own is None else own for own in best_history(record.beliefs)]
        self.true_classes = dict(zip(record.truth.objects.object_ids, record.truth.objects.class_names, strict=True))
        self.matches = self._matches()

    @property
    def num_existing(self) -> int:
        """Objects that are said to be there at the end."""
        return int((self.record.beliefs[-1].existence > EXISTS).sum())

    @property
    def num_others(self) -> int:
        """Objects that are said to be there and stand for no true one."""
        last, known = self.record.beliefs[-1], set(self.matches.values())
        return sum(
            bool(own > EXISTS) and int(n) not in known for n, own in zip(last.object_ids, last.existence, strict=True)
        )

    @property
    def existence(self) -> dict[str, float]:
        """Existence of every true object at the end; 0 where none stands for it."""
        last = self.record.beliefs[-1]
        by_id = dict(zip(last.object_ids.tolist(), last.existence.tolist(), strict=True))
        return {true: by_id.get(self.matches.get(true, -1), 0.0) for true in self.true_classes}

    def believed(self, names: Mapping[str, str]) -> list[Course]:
        """What the beliefs say, their classes called by ``names`` where these list them."""
        last = self.record.beliefs[-1]
        columns = [CLASSES.index(names.get(name, name)) for name in last.class_names]
        courses = []
        for true, first in self._seen():
            rows = [self._row(k, self.matches.get(true, -1), columns) for k in range(first, len(self.record.beliefs))]
            courses.append(self._course(true, np.array(rows)))
        return courses

    def views(self, true: str) -> list[list[Told]]:
        """What the detector said of the object at each keyframe, by the association that is the best in the end."""
        number, found = self.matches.get(true, -1), []
        for belief, objects in zip(self.record.beliefs, self.history, strict=True):
            rows = belief.detection_ids[objects == number].tolist() if len(objects) else []
            found.append([self._told(belief.stamp_ns, row) for row in rows])
        return found

    def by_views(self, rule: Rule) -> list[Course]:
        """What a rule makes of the views of each object so far."""
        courses = []
        for true, first in self._seen():
            views = self.views(true)
            so_far = [told for own in views[:first] for told in own]
            rows = []
            for own in views[first:]:
                so_far += own
                rows.append(rule(so_far))
            courses.append(self._course(true, np.array(rows)))
        return courses

    def _course(self, true: str, rows: Array) -> Course:
        return Course(object_id=true, probabilities=rows, true_class=self.true_classes[true])

    def _row(self, keyframe: int, number: int, columns: list[int]) -> Array:
        """(C,) at one keyframe; even where the map has not got the object."""
        belief = self.record.beliefs[keyframe]
        places: Index = np.flatnonzero(belief.object_ids == number)
        if not len(places):
            return np.full(len(CLASSES), 1.0 / len(CLASSES))
        row = np.zeros(len(CLASSES))
        np.add.at(row, columns, belief.class_probabilities[places[0]])
        return row

    def _told(self, stamp_ns: int, detection: int) -> Told:
        measured = self.record.measurements[stamp_ns]
        row = measured.detection_ids.tolist().index(detection)
        scores = np.full(len(CLASSES), np.nan)
        for name, score in zip(measured.class_names, measured.class_scores[row], strict=True):
            if name in CLASSES:
                scores[CLASSES.index(name)] = score
        return Told(label=measured.labels[row], scores=scores)

    def _seen(self) -> Iterator[tuple[str, int]]:
        """Every true object with the keyframe of its first detection; one that is never detected is no one's fault."""
        for true in self.true_classes:
            for k, belief in enumerate(self.record.beliefs):
                if true in self.truth.associations.get(belief.stamp_ns, ()):
                    yield true, k
                    break

    def _matches(self) -> dict[str, int]:
        """Object id of every true object that the map has: the one that shares most of its detections."""
        pairs = [
            (true, int(found))
            for belief, objects in zip(self.record.beliefs, self.history, strict=True)
            for row, found in zip(belief.detection_ids.tolist(), objects, strict=False)
            if (true := self.truth.associations[belief.stamp_ns][row])
        ]
        return match_objects(tuple(self.true_classes), {}, pairs)
