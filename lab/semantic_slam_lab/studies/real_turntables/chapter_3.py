"""Chapter 3 on photographs: classification of five objects along tracks, model and localisation uncertainty."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam_lab.repetitions import repeat
from semantic_slam_lab.studies.ch3.metrics import summary
from semantic_slam_lab.studies.real_turntables.classification import (
    METHODS,
    SIGMAS_M,
    DrawData,
    DrawOutcome,
    outcome_of,
)
from semantic_slam_lab.studies.real_turntables.lookalikes import Draw
from semantic_slam_lab.studies.real_turntables.photographs import FRONT_RAD, Photographs
from semantic_slam_lab.studies.real_turntables.tracks import RANGE_M, Track, tracks_of
from semantic_slam_lab.studies.real_turntables.trunk import Clutter, cluttered_features

ROOMS = 2
"""Rooms that every training view stands in, beside the plain picture."""
TRACK_ROOM: Clutter = ("track", 0)
BEHIND_RAD = float(np.deg2rad(100.0))


@dataclass(frozen=True)
class RoomFeatures:
    """Pooled features of views in rooms, by row of the photographs and room."""

    rows: Mapping[tuple[int, Clutter], int]
    pooled: Array

    def of(self, views: Sequence[int] | Index, room: Clutter) -> Array:
        """(V, K) of the views in one room."""
        return self.pooled[[self.rows[int(view), room] for view in views]]


def outcomes(
    photographs: Photographs,
    pooled: Array,
    draws: Sequence[Draw],
    settings: PerceptionConfiguration,
    jobs: int,
    seed: int,
) -> list[DrawOutcome]:
    """What came of every draw."""
    tracks = [tracks_of(photographs, draw, seed) for draw in draws]
    rooms = _rooms(photographs, draws, tracks, settings, jobs)
    data = [_data(photographs, pooled, rooms, *each) for each in zip(draws, tracks, strict=True)]
    return repeat(outcome_of, [(own, seed) for own in data], jobs, "draws")


def numbers(found: Sequence[DrawOutcome]) -> dict[str, Any]:
    """Uncertainty -> method -> metrics over all tracks of all draws."""
    pooled = {
        name: {method: np.concatenate([own.posteriors[name][method] for own in found]) for method in METHODS}
        for name in SIGMAS_M
    }
    return {name: {method: summary(logs) for method, logs in own.items()} for name, own in pooled.items()}


def ambiguity(draws: Sequence[Draw], found: Sequence[DrawOutcome]) -> list[dict[str, Any]]:
    """How unsure one view leaves which of two look-alikes it is, in front and from behind; a row for every pair."""
    rows: dict[tuple[str, ...], dict[str, Any]] = {}
    for draw, own in zip(draws, found, strict=True):
        away = np.abs(own.pair_azimuth_rad)
        rows.setdefault(
            draw.names[:2],
            {
                "pair": " / ".join(draw.names[:2]),
                "front": float(own.pair_entropy[away <= FRONT_RAD].mean()),
                "behind": float(own.pair_entropy[away >= BEHIND_RAD].mean()),
            },
        )
    return list(rows.values())


def _rooms(
    photographs: Photographs,
    draws: Sequence[Draw],
    tracks: Sequence[Sequence[Track]],
    settings: PerceptionConfiguration,
    jobs: int,
) -> RoomFeatures:
    used = sorted({name for draw in draws for name in draw.names})
    training = np.concatenate([photographs.training(name) for name in used])
    tested = np.unique(np.concatenate([track.rows[track.cluttered] for own in tracks for track in own]))
    wanted = [(int(view), ("train", room)) for room in range(ROOMS) for view in training]
    wanted += [(int(view), TRACK_ROOM) for view in tested]
    views = [photographs.views[view] for view, _ in wanted]
    features = cluttered_features(settings, views, [room for _, room in wanted], jobs)
    return RoomFeatures({key: index for index, key in enumerate(wanted)}, features.pooled)


def _data(
    photographs: Photographs, pooled: Array, rooms: RoomFeatures, draw: Draw, tracks: Sequence[Track]
) -> DrawData:
    def seen(views: Index) -> Array:
        """Plain, then in every room of training."""
        return np.concatenate([pooled[views], *(rooms.of(views, ("train", room)) for room in range(ROOMS))])

    training, front, labels = [], [], []
    for index, name in enumerate(draw.names):
        views = photographs.training(name)
        training.append((np.tile(_places(photographs, views), (1 + ROOMS, 1)), seen(views)))
        front.append(seen(photographs.front(views)))
        labels += [index] * len(front[-1])
    along = []
    for track in tracks:
        features = pooled[track.rows]
        features[track.cluttered] = rooms.of(track.rows[track.cluttered], TRACK_ROOM)
        along.append((track, features))
    others = [(index, photographs.others(name)) for index, name in enumerate(draw.names[:2])]
    pair = [(index, photographs.azimuth_rad[views], pooled[views]) for index, views in others]
    return DrawData(draw, training, (np.concatenate(front), np.array(labels)), along, pair)


def _places(photographs: Photographs, views: Index) -> Array:
    azimuth = photographs.azimuth_rad[views]
    return RANGE_M * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
