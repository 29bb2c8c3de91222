"""The engine in a room, with what it sees or without: which detections are of one thing, and is a thing found?"""

from collections.abc import Sequence

import numpy as np

from semantic_slam.answers.appearances import Appearances, appearances_of
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.configuration import Configuration
from semantic_slam.evaluation.association import pair_score
from semantic_slam.evaluation.history import best_history
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.embeddings.gallery import Gallery, Thing
from semantic_slam_lab.studies.embeddings.questions import Asked
from semantic_slam_lab.studies.embeddings.rooms import CLUTTER, Room, make_room

METHODS = ("embedding", "none")
NUM_ASKED = 3
"""Questions for each thing."""
SAME_SIDE_RAD = np.deg2rad(20.0)
"""From a view that the robot had."""


def configuration(method: str) -> Configuration:
    """An open world with the class models ``method``; all else as in a room with a detector."""
    return Configuration.of(
        association="open",
        semantic_model={"kind": method},
        open_world={
            "max_range_m": 4.0,
            "field_of_view_rad": 1.9,
            "detection_probability": 0.85,
            "clutter_per_frame": 0.15,
            "iterate_updates": False,
        },
        initial_pose={"sigma": (0.01, 0.01, 0.01)},
        pruning={"max_hypotheses": 20},
    )


def driven(gallery: Gallery, seed: int, num_keyframes: int) -> tuple[dict[str, dict[str, float]], list[Asked]]:
    """Metrics of one room by method, and the questions to the map of the first one."""
    room = make_room(gallery, seed, num_keyframes)
    metrics, asked = {}, list[Asked]()
    for method in METHODS:
        engine = Engine(configuration(method))
        beliefs = [engine.process(keyframe) for keyframe in room.keyframes]
        found = _ids(beliefs)
        metrics[method] = _metrics(beliefs, found, room)
        if method == METHODS[0]:
            told = {keyframe.stamp_ns: keyframe.measurements for keyframe in room.keyframes}
            looks = appearances_of(beliefs, told, configuration(method).semantic_model)
            asked = _asked(beliefs[-1], looks, found, room, seed)
    return metrics, asked


def _ids(beliefs: Sequence[HybridBelief]) -> list[list[int]]:
    """Objects of each keyframe's detections in the best history."""
    return [[] if own is None else own.tolist() for own in best_history(beliefs)]


def _metrics(beliefs: Sequence[HybridBelief], found: list[list[int]], room: Room) -> dict[str, float]:
    """Scores of the pairs of detections, and of the objects at the end."""
    flat = [number for own in found for number in own], [number for own in room.true_ids for number in own]
    pairs = pair_score(*flat)
    seen = {number for number in flat[1] if number != CLUTTER}
    return {
        "association_f1": pairs.f1,
        "association_precision": pairs.precision,
        "association_recall": pairs.recall,
        "num_objects": float((beliefs[-1].existence > 0.5).sum()),
        "num_true_objects": float(len(seen)),
    }


def _asked(belief: HybridBelief, looks: Appearances, found: list[list[int]], room: Room, seed: int) -> list[Asked]:
    """Views of what is in the room, and of what is not, to the map that the robot made."""
    random = keyed_generator("embeddings", "room questions", seed)
    right_of, ids = _majorities(found, room), belief.object_ids.tolist()
    asked = []
    things = [(own, right_of.get(number)) for number, own in enumerate(room.things)]
    for number, (thing, right) in enumerate([*things, *((own, None) for own in room.strange)]):
        place = ids.index(right) if right in ids else None
        for row in random.permutation(len(thing.azimuths))[:NUM_ASKED]:
            answer = find_objects(belief, Question(vector=thing.vectors[row]), looks)
            ours = np.append(np.zeros(len(ids)), answer.unknown)
            for item in answer.objects:
                ours[ids.index(item.object_id)] = item.probability
            group = "not on the map" if place is None else _side(room, number, thing, row)
            true = len(ids) if place is None else place
            asked.append(Asked(group=group, ours=ours, cosine=np.zeros(0), right=true))
    return asked


def _side(room: Room, number: int, thing: Thing, row: int) -> str:
    """Whether a view is from a side that the robot saw."""
    off = np.abs(np.angle(np.exp(1j * (np.array(room.seen_from[number]) - thing.azimuths[row]))))
    return "seen side" if off.min(initial=np.pi) < SAME_SIDE_RAD else "unseen side"


def _majorities(found: list[list[int]], room: Room) -> dict[int, int]:
    """Thing -> object that most of its detections are of."""
    counts: dict[tuple[int, int], int] = {}
    for own, true in zip(found, room.true_ids, strict=True):
        for number, thing in zip(own, true, strict=True):
            if number >= 0 and thing != CLUTTER:
                counts[thing, number] = counts.get((thing, number), 0) + 1
    best: dict[int, int] = {}
    for (thing, number), _ in sorted(counts.items(), key=lambda item: (item[1], item[0])):
        best[thing] = number
    return best
