"""Maps of things that a robot has passed, and questions to them by vectors of other views."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from semantic_slam.answers.appearances import Appearances, SeenView
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.evaluation.classification import expected_calibration_error, negative_log_likelihood
from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.embeddings.gallery import Gallery, Thing
from semantic_slam_lab.studies.embeddings.known_map import map_of

NUM_MAPPED, NUM_ASKED = 20, 4
"""Things on a map, and questions for each of them, and for each of as many that are not on it."""
PASSES = {"around": 2.0 * np.pi, "half way": np.deg2rad(160.0)}
"""How far a robot goes around each thing."""
STEP_RAD, DIRECTION_SIGMA_RAD = np.deg2rad(20.0), 0.05
"""Between its views, and its error of where it sees them from."""
TEMPERATURE = 0.01
"""Divides cosines, as CLIP's classifiers have it."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Probabilities of one question over O objects and none of them, and which is right."""

    group: str  # "between": from between its views, "elsewhere": from a side that was not seen, "not mapped"
    ours: Array  # (O + 1,)
    cosine: Array  # (O + 1,)
    right: int


def asked_of_map(gallery: Gallery, pass_name: str, seed: int) -> list[Asked]:
    """All questions to one map."""
    random = keyed_generator("embeddings", gallery.network, pass_name, seed)
    chosen = random.permutation(len(gallery.things))
    things = [gallery.things[number] for number in chosen]
    mapped, others = things[:NUM_MAPPED], things[NUM_MAPPED : 2 * NUM_MAPPED]
    starts = random.uniform(-np.pi, np.pi, len(mapped))
    seen = [_seen(thing, start, PASSES[pass_name]) for thing, start in zip(mapped, starts, strict=True)]
    views = [
        SeenView(
            object_id=number,
            vector=thing.vectors[row],
            place=CameraPlaces.one(float(thing.azimuths[row] + random.normal(0.0, DIRECTION_SIGMA_RAD)), 0.0),
        )
        for number, (thing, rows) in enumerate(zip(mapped, seen, strict=True))
        for row in rows
    ]
    looks = Appearances.of(views, [], SemanticModelConfiguration())
    return list(_asked(mapped, others, starts, seen, PASSES[pass_name], looks, random))


def _seen(thing: Thing, start: float, extent: float) -> list[int]:
    """Rows of the views that a robot takes on its way around."""
    steps = start + np.arange(0.0, extent - 1e-9, STEP_RAD)
    return list(dict.fromkeys(thing.nearest(azimuth) for azimuth in steps))


def _asked(
    mapped: list[Thing],
    others: list[Thing],
    starts: Array,
    seen: list[list[int]],
    extent: float,
    looks: Appearances,
    random: np.random.Generator,
) -> Iterator[Asked]:
    known = map_of(len(mapped))
    pictures = [thing.vectors[rows] for thing, rows in zip(mapped, seen, strict=True)]

    def answer(vector: Array, group: str, right: int) -> Asked:
        found = find_objects(known, Question(vector=vector), looks)
        ours = np.zeros(len(mapped) + 1)
        ours[[item.object_id for item in found.objects]] = [item.probability for item in found.objects]
        ours[-1] = found.unknown
        return Asked(group=group, ours=ours, cosine=_by_cosine(vector, pictures), right=right)

    for number, (thing, rows) in enumerate(zip(mapped, seen, strict=True)):
        rest = np.setdiff1d(np.arange(len(thing.azimuths)), rows)
        inside = (thing.azimuths[rest] - starts[number]) % (2.0 * np.pi) < extent
        for group, part in (("between", rest[inside]), ("elsewhere", rest[~inside])):
            for row in random.permutation(part)[:NUM_ASKED]:
                yield answer(thing.vectors[row], group, number)
    for thing in others:
        for row in random.permutation(len(thing.azimuths))[:NUM_ASKED]:
            yield answer(thing.vectors[row], "not mapped", len(mapped))


def _by_cosine(vector: Array, pictures: list[Array]) -> Array:
    """(O + 1,) softmax of the largest cosine with each object's views; it knows of nothing that is not there."""
    unit = vector / np.linalg.norm(vector)
    best = [float((own @ unit / np.linalg.norm(own, axis=1)).max()) for own in pictures]
    logits = np.array(best) / TEMPERATURE
    weights = np.exp(logits - logits.max())
    return np.append(weights / weights.sum(), 0.0)


def scores(asked: list[Asked], method: str) -> dict[str, float]:
    """Metrics of some questions; nothing where there are none."""
    if not asked:
        return {}
    rows = [getattr(own, method) for own in asked]
    longest = max(len(row) for row in rows)  # maps have objects in different numbers
    probabilities = np.array([np.pad(row, (0, longest - len(row))) for row in rows])
    right = np.array([own.right for own in asked])
    return {
        "num_questions": len(asked),
        "right": float((probabilities.argmax(axis=1) == right).mean()),
        "ece": expected_calibration_error(probabilities, right),
        "nll": negative_log_likelihood(probabilities, right),
        "found_at_half": float((probabilities[np.arange(len(right)), right] > 0.5).mean()),
    }
