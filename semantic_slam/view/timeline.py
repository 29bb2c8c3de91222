"""Newest keyframes of a run as drawn by the page, each with the number of the change that added it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.report.plain_json import plain
from semantic_slam.report.shown.keyframe import hypothesis_rows, keyframe_scene
from semantic_slam.report.shown.scene import SHOWN_HYPOTHESES
from semantic_slam.view.shown_objects import ShownObjects

KEPT = 600
"""Keyframes; of older ones the page knows nothing."""
KEPT_HYPOTHESES = 100
"""Heaviest hypotheses of a keyframe that may be drawn later, as ancestors of heavy ones."""
RIVALS_SHOWN, LEAST_WEIGHT = 30, 0.02
"""Keyframes of whose rival hypotheses of such a weight the map has to show all."""
NUMBERS = ("unexplained", "discarded_mass", "discarded_mass_window", "association_entropy", "dropped", "num_candidates")
"""Quantities of a belief that the page states as they are."""


@dataclass
class Moment:
    """One keyframe that is kept."""

    version: int
    stamp_ns: int
    scene: dict[str, Any]  # replaced, never changed: whoever writes it down may have it in hand
    parents: dict[int, int]  # by hypothesis
    rows: dict[int, list[float]]  # by hypothesis, as the page draws it
    places: dict[int, int]  # in the scene, by hypothesis
    corners: Array  # (2, 2) of what the map has to show: lowest and highest x and y

    def draw(self, hypothesis: int, parent_place: int, version: int) -> int:
        """Have a hypothesis drawn; returns its place in the scene."""
        self.places[hypothesis] = len(self.places)
        row = [parent_place, *self.rows[hypothesis][1:]]
        self.scene = self.scene | {"h": [*self.scene["h"], row]}
        self.version = version
        return self.places[hypothesis]


class Timeline:
    """The keyframes of one run; hypotheses that are found to be ancestors of heavy ones are drawn later."""

    def __init__(self) -> None:
        self.moments: list[Moment] = []
        self.objects = ShownObjects()
        self.start_ns = 0

    def add(self, belief: HybridBelief, version: int) -> None:
        """Take in the next keyframe's belief."""
        if not self.moments:
            self.start_ns = belief.stamp_ns
        heaviest = np.argsort(-belief.log_weights, kind="stable")[:KEPT_HYPOTHESES].tolist()
        ids = [int(belief.hypothesis_ids[row]) for row in heaviest]
        gone = self.objects.note(belief, version)
        scene = keyframe_scene(belief, self.start_ns, [], self.objects.places, self.objects.written)
        scene["o"] += [[place] for place in gone]
        scene = plain(scene | _numbers(belief))
        rows = plain(hypothesis_rows(belief, heaviest, {}))
        self.moments.append(
            Moment(
                version=version,
                stamp_ns=belief.stamp_ns,
                scene=scene,
                parents={own: int(belief.parent_ids[row]) for own, row in zip(ids, heaviest, strict=True)},
                rows=dict(zip(ids, rows, strict=True)),
                places={},
                corners=_corners(_points(scene, rows)),
            )
        )
        for hypothesis in ids[:SHOWN_HYPOTHESES]:
            self._draw(hypothesis, version)
        if len(self.moments) > KEPT:
            self._forget_first()

    def changed_since(self, version: int) -> list[dict[str, Any]]:
        """Scenes of the keyframes that are newer than ``version``, or that something was added to since."""
        return [moment.scene for moment in self.moments if moment.version > version]

    def has(self, belief: HybridBelief) -> bool:
        """Whether this very belief is one of the keyframes."""
        same = [moment for moment in self.moments if moment.scene["k"] == belief.keyframe]
        best = int(belief.hypothesis_ids[np.argmax(belief.log_weights)])
        return bool(same) and same[0].stamp_ns == belief.stamp_ns and best in same[0].parents

    def to_be_seen(self) -> Array:
        """(N, 2) points that the map has to show: paths and objects, and the rivals of late that weigh something."""
        recent = [row for moment in self.moments[-RIVALS_SHOWN:] for row in moment.scene["h"]]
        rivals = [row[2:4] for row in recent if (row[1] or 0.0) > LEAST_WEIGHT]
        corners = np.concatenate([moment.corners for moment in self.moments])
        return np.concatenate([corners, np.array(rivals, dtype=np.float64).reshape(-1, 2)])

    @property
    def newest(self) -> int:
        """The newest keyframe, -1 before the first."""
        return int(self.moments[-1].scene["k"]) if self.moments else -1

    @property
    def oldest(self) -> int:
        """The oldest keyframe that is kept, -1 before the first."""
        return int(self.moments[0].scene["k"]) if self.moments else -1

    def _draw(self, hypothesis: int, version: int) -> None:
        """Draw one of the newest hypotheses, and those of its ancestors that are not drawn yet."""
        at, chain = len(self.moments) - 1, []
        while at >= 0 and hypothesis in self.moments[at].rows and hypothesis not in self.moments[at].places:
            chain.append((self.moments[at], hypothesis))
            hypothesis = self.moments[at].parents[hypothesis]
            at -= 1
        place = self.moments[at].places.get(hypothesis, -1) if at >= 0 else -1
        for moment, own in reversed(chain):
            place = moment.draw(own, place, version)

    def _forget_first(self) -> None:
        """Drop the oldest keyframe; the next one then tells of all objects, not only of those that changed."""
        first = self.moments.pop(0).scene["o"]
        oldest = self.moments[0]
        states = {row[0]: row for row in [*first, *oldest.scene["o"]]}
        self.objects.free(place for place, row in states.items() if len(row) == 1)
        oldest.scene = oldest.scene | {"o": [row for row in states.values() if len(row) > 1]}


def _numbers(belief: HybridBelief) -> dict[str, float | None]:
    values = {name: float(getattr(belief, name)) for name in NUMBERS}
    return {name: float(f"{value:.10g}") if np.isfinite(value) else None for name, value in values.items()}


def _points(scene: dict[str, Any], rows: list[list[float]]) -> list[list[float]]:
    """Where the best hypothesis and the objects are that a keyframe tells of."""
    heaviest = max(rows, key=lambda row: row[1] or 0.0)
    return [heaviest[2:4], *(row[1:3] for row in scene["o"] if len(row) > 1)]


def _corners(points: list[list[float]]) -> Array:
    """(2, 2) lowest and highest x and y of points."""
    every = np.array(points, dtype=np.float64)
    return np.stack([every.min(axis=0), every.max(axis=0)])
