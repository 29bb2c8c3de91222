"""The labelled views of each object, from the sightings of a run."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.building.class_prior import class_prior
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior, parse_map_prior
from semantic_slam.perception.class_names import NONE_OF_THESE
from semantic_slam.training.runs import Run
from semantic_slam.training.sightings import LEAST_RANGE_M, SightingReader, Sightings, sightings_of, stretch_of
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, STEP_RAD
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord


@dataclass(frozen=True, kw_only=True)
class Track:
    """Views that are of one object, in the order of the drive."""

    object_id: int
    views: tuple[LabelView, ...]  # V
    stretches: tuple[int, ...]  # (V,) of the drive
    weight: float  # probability that the object is there and these are its views
    log_prior: Array | None  # (C,) of its class, where a map tells it


def tracks_of(run: Run, labels: tuple[str, ...], edges: Sequence[int]) -> list[Track]:
    """What a run tells of its objects; ``labels`` are the words, ``edges`` where stretches begin and the last ends."""
    reader = _Reader(run, labels)
    return [reader.track(own, edges) for own in sightings_of(run)]


class _Reader:
    """Reads what the detector says of a detection, and from where."""

    def __init__(self, run: Run, labels: tuple[str, ...]) -> None:
        self._sightings, self._words = SightingReader(run), WordReader(labels)
        self._names = (*labels, NONE_OF_THESE)
        prior = parse_map_prior(run.record.run.map_prior, "map prior") if run.record.run.map_prior else MapPrior()
        self._mapped: dict[int, ObjectPrior] = {item.object_id: item for item in prior.objects}

    def track(self, own: Sightings, edges: Sequence[int]) -> Track:
        """The track of an object."""
        stretches = [stretch_of(self._sightings.stamp_ns(keyframe), edges) for keyframe, _ in own.places]
        return Track(
            object_id=own.object_id,
            views=tuple(self._view(own.object_id, *place) for place in own.places),
            stretches=tuple(stretches),
            weight=own.weight,
            log_prior=self._log_prior(own.object_id),
        )

    def _log_prior(self, number: int) -> Array | None:
        mapped = self._mapped.get(number)
        return np.asarray(np.log(class_prior(mapped, self._names))) if mapped is not None else None

    def _view(self, number: int, keyframe: int, detection: int) -> LabelView:
        row = self._sightings.row(keyframe, detection)
        words = self._words.words(self._sightings.measured(keyframe).take(np.array([row])))
        direction, elevation, away = self._sightings.seen_from(number, keyframe)
        return LabelView(
            word=LabelWord(answer=int(words.answers[0]), shares=words.shares[0]),
            direction=round(direction / STEP_RAD) % DIRECTIONS,
            elevation=round(elevation / STEP_RAD),
            log_range=STEP_RAD * round(np.log(max(away, LEAST_RANGE_M)) / STEP_RAD),
        )
