"""The views of each object, as the hypotheses that live at the end of a run associate them, by their weights.

Viewpoints are where the belief has the robot stand about the object when it sees it. Neither they nor the associations
are touched by what is fitted to them.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.history import best_index, histories, lineage
from semantic_slam.evaluation.seen_from import seen_from
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building.class_prior import class_prior
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior, parse_map_prior
from semantic_slam.perception.boxes.same_outline import joined
from semantic_slam.perception.class_names import NONE_OF_THESE
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.training.labels.runs import Run
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, STEP_RAD
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord

LEAST_WEIGHT = 0.01
"""Tracks that are less likely are left out."""
LEAST_RANGE_M = 0.05
"""Nearer views count as from there, as they do in a run."""
Place = tuple[int, int]
"""Keyframe and detection of it, by their places in the run."""


@dataclass(frozen=True, kw_only=True)
class Track:
    """Views that are of one object, in the order of the drive."""

    object_id: int
    views: tuple[LabelView, ...]  # V
    stretches: tuple[int, ...]  # (V,) of the drive
    weight: float  # probability that the object is there and these are its views
    log_prior: Array | None  # (C,) of its class, where a map tells it


def stretch_edges(run: Run, count: int) -> tuple[int, ...]:
    """(count + 1,) stamps that divide a drive into stretches of as many keyframes, in nanoseconds."""
    stamps = np.array([belief.stamp_ns for belief in run.record.beliefs])
    starts = np.round(np.linspace(0, len(stamps), count + 1)).astype(int)[:-1]
    return (*stamps[starts].tolist(), int(stamps[-1]))


def tracks_of(run: Run, labels: tuple[str, ...], edges: Sequence[int]) -> list[Track]:
    """What a run tells of its objects; ``labels`` are the words, ``edges`` where stretches begin and the last ends."""
    beliefs = run.record.beliefs
    weights = np.exp(beliefs[-1].log_weights)
    existence = dict(zip(beliefs[-1].object_ids.tolist(), beliefs[-1].existence.tolist(), strict=True))
    found: dict[tuple[int, tuple[Place, ...]], float] = defaultdict(float)
    for own, weight in zip(_by_hypothesis(beliefs), weights.tolist(), strict=True):
        for number, places in own.items():
            found[number, tuple(places)] += weight * existence.get(number, 0.0)
    reader = _Reader(run, labels)
    kept = {key: weight for key, weight in found.items() if weight >= LEAST_WEIGHT}
    return [reader.track(number, places, weight, edges) for (number, places), weight in kept.items()]


def _by_hypothesis(beliefs: Sequence[HybridBelief]) -> list[dict[int, list[Place]]]:
    """For each hypothesis of the last belief: object id -> detections of it."""
    rows = histories(beliefs)
    found = [defaultdict[int, list[Place]](list) for _ in beliefs[-1].log_weights]
    for keyframe, row in enumerate(rows):
        for hypothesis, detection in zip(*np.nonzero(row >= 0), strict=True):
            found[hypothesis][int(row[hypothesis, detection])].append((keyframe, int(detection)))
    return [dict(own) for own in found]


class _Reader:
    """Reads what the detector says of a detection, and from where."""

    def __init__(self, run: Run, labels: tuple[str, ...]) -> None:
        self._run, self._words = run, WordReader(labels)
        self._names = (*labels, NONE_OF_THESE)
        prior = parse_map_prior(run.record.run.map_prior, "map prior") if run.record.run.map_prior else MapPrior()
        self._mapped: dict[int, ObjectPrior] = {item.object_id: item for item in prior.objects}
        self._ancestors = lineage(run.record.beliefs)
        self._measured: dict[int, SemanticMeasurements] = {}

    def track(self, number: int, places: tuple[Place, ...], weight: float, edges: Sequence[int]) -> Track:
        """The track of an object."""
        stamps = [self._run.record.beliefs[keyframe].stamp_ns for keyframe, _ in places]
        stretches = np.clip(np.searchsorted(edges, stamps, side="right") - 1, 0, len(edges) - 2)
        return Track(
            object_id=number,
            views=tuple(self._view(number, *place) for place in places),
            stretches=tuple(stretches.tolist()),
            weight=weight,
            log_prior=self._log_prior(number),
        )

    def _log_prior(self, number: int) -> Array | None:
        mapped = self._mapped.get(number)
        return np.asarray(np.log(class_prior(mapped, self._names))) if mapped is not None else None

    def _view(self, number: int, keyframe: int, detection: int) -> LabelView:
        belief = self._run.record.beliefs[keyframe]
        measured = self._measurements(belief.stamp_ns)
        row = measured.detection_ids.tolist().index(belief.detection_ids[detection])
        words = self._words.words(measured.take(np.array([row])))
        direction, elevation, away = self._seen_from(number, keyframe, measured)
        return LabelView(
            word=LabelWord(answer=int(words.answers[0]), shares=words.shares[0]),
            direction=round(direction / STEP_RAD) % DIRECTIONS,
            elevation=round(elevation / STEP_RAD),
            log_range=STEP_RAD * round(np.log(max(away, LEAST_RANGE_M)) / STEP_RAD),
        )

    def _measurements(self, stamp_ns: int) -> SemanticMeasurements:
        """Measurements of a keyframe, as the run took them."""
        if stamp_ns not in self._measured:
            told = self._run.record.measurements[stamp_ns]
            self._measured[stamp_ns] = joined(told, self._run.configuration)
        return self._measured[stamp_ns]

    def _seen_from(self, number: int, keyframe: int, measured: SemanticMeasurements) -> tuple[float, float, float]:
        """Azimuth and elevation from object to camera in map [rad] and their distance [m], by the keyframe's belief."""
        beliefs = self._run.record.beliefs
        belief = next(own for own in (beliefs[keyframe], beliefs[-1]) if number in own.object_ids)
        pose = beliefs[keyframe].poses[self._hypothesis(keyframe)]
        place = belief.object_poses[belief.object_ids.tolist().index(number), :3]
        return seen_from(pose, place, measured.sensor_position, in_space=self._run.configuration.is_spatial)

    def _hypothesis(self, keyframe: int) -> int:
        """The one that becomes the heaviest in the end, else the heaviest of that keyframe."""
        known = self._ancestors[keyframe]
        return known if known >= 0 else best_index(self._run.record.beliefs[keyframe])
