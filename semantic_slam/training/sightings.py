"""Which detections of a run show which object, as the hypotheses that live at its end associate them.

They are weighed by the probabilities of the hypotheses and of the objects' existence. Viewpoints are where the belief
has the robot stand about the object. Neither they nor the associations are touched by what is fitted to them.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.history import best_index, histories, lineage
from semantic_slam.evaluation.seen_from import seen_from
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.perception.boxes.same_outline import joined
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.training.runs import Run

LEAST_WEIGHT = 0.01
"""Sightings that are less likely are left out."""
LEAST_RANGE_M = 0.05
"""Nearer views count as from there, as they do in a run."""
Place = tuple[int, int]
"""Keyframe and detection of it, by their places in the run."""


@dataclass(frozen=True, kw_only=True)
class Sightings:
    """Detections that are of one object, in the order of the drive."""

    object_id: int
    places: tuple[Place, ...]
    weight: float  # probability that the object is there and these are its detections


def stretch_edges(run: Run, count: int) -> tuple[int, ...]:
    """(count + 1,) stamps that divide a drive into stretches of as many keyframes, in nanoseconds."""
    stamps = np.array([belief.stamp_ns for belief in run.record.beliefs])
    starts = np.round(np.linspace(0, len(stamps), count + 1)).astype(int)[:-1]
    return (*stamps[starts].tolist(), int(stamps[-1]))


def stretch_of(stamp_ns: int, edges: Sequence[int]) -> int:
    """Index of the stretch between ``edges`` that contains a stamp of the drive."""
    return int(np.clip(np.searchsorted(edges, stamp_ns, side="right") - 1, 0, len(edges) - 2))


def sightings_of(run: Run) -> list[Sightings]:
    """What the hypotheses at the end of a run hold of each object; those that agree count as one."""
    beliefs = run.record.beliefs
    found: dict[tuple[int, tuple[Place, ...]], float] = defaultdict(float)
    detected: dict[int, float] = defaultdict(float)
    for own, weight in zip(_by_hypothesis(beliefs), np.exp(beliefs[-1].log_weights).tolist(), strict=True):
        for number, places in own.items():
            found[number, tuple(places)] += weight
            detected[number] += weight
    ids = beliefs[-1].object_ids.tolist()
    exist = existence_if_detected(beliefs[-1].existence, np.array([detected[number] for number in ids]))
    exists = dict(zip(ids, exist.tolist(), strict=True))
    every = [
        Sightings(object_id=number, places=places, weight=weight * exists.get(number, 0.0))
        for (number, places), weight in found.items()
    ]
    return [own for own in every if own.weight >= LEAST_WEIGHT]


def existence_if_detected(existence: Array, detected: Array) -> Array:
    """(O,) existence probability of objects under the hypotheses that detected them.

    ``existence`` (O,) is that of the belief, sum_h w_h P(exists | h), in which the weights of the hypotheses are
    counted already; ``detected`` (O,) is the total weight of the hypotheses with a detection of the object. All of the
    former is attributed to the latter, up to certainty: what no other hypothesis has exists in these alone, and what
    a map tells to exist does so for certain where it was detected.
    """
    return np.asarray(np.minimum(existence / np.where(detected > 0.0, detected, 1.0), 1.0))


def _by_hypothesis(beliefs: Sequence[HybridBelief]) -> list[dict[int, list[Place]]]:
    """For each hypothesis of the last belief: object id -> detections of it."""
    rows = histories(beliefs)
    found = [defaultdict[int, list[Place]](list) for _ in beliefs[-1].log_weights]
    for keyframe, row in enumerate(rows):
        for hypothesis, detection in zip(*np.nonzero(row >= 0), strict=True):
            found[hypothesis][int(row[hypothesis, detection])].append((keyframe, int(detection)))
    return [dict(own) for own in found]


class SightingReader:
    """Reads what was measured of a detection, and from where."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._ancestors = lineage(run.record.beliefs)
        self._measured: dict[int, SemanticMeasurements] = {}

    def stamp_ns(self, keyframe: int) -> int:
        """Stamp of a keyframe."""
        return self._run.record.beliefs[keyframe].stamp_ns

    def measured(self, keyframe: int) -> SemanticMeasurements:
        """Measurements of a keyframe, as the run took them."""
        stamp_ns = self.stamp_ns(keyframe)
        if stamp_ns not in self._measured:
            self._measured[stamp_ns] = joined(self._run.record.measurements[stamp_ns], self._run.configuration)
        return self._measured[stamp_ns]

    def row(self, keyframe: int, detection: int) -> int:
        """Row of a detection among the measurements of its keyframe."""
        wanted = self._run.record.beliefs[keyframe].detection_ids[detection]
        return int(self.measured(keyframe).detection_ids.tolist().index(wanted))

    def seen_from(self, number: int, keyframe: int) -> tuple[float, float, float]:
        """Azimuth and elevation from object to camera in map [rad] and their distance [m], by the keyframe's belief."""
        beliefs = self._run.record.beliefs
        belief = next(own for own in (beliefs[keyframe], beliefs[-1]) if number in own.object_ids)
        pose = beliefs[keyframe].poses[self._hypothesis(keyframe)]
        place = belief.object_poses[belief.object_ids.tolist().index(number), :3]
        sensor = self.measured(keyframe).sensor_position
        return seen_from(pose, place, sensor, in_space=self._run.configuration.is_spatial)

    def _hypothesis(self, keyframe: int) -> int:
        """The one that becomes the heaviest in the end, else the heaviest of that keyframe."""
        known = self._ancestors[keyframe]
        return known if known >= 0 else best_index(self._run.record.beliefs[keyframe])
