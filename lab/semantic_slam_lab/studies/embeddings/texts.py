"""Questions by named vectors of texts, drawn: they lie elsewhere than pictures do, and point at what they name."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.answers.appearances import Appearances, SeenView
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.evaluation.classification import expected_calibration_error
from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.embeddings.gallery import Gallery
from semantic_slam_lab.studies.embeddings.known_map import map_of

NUM_MAPPED, NUM_NAMES, VIEWS = 15, 30, 8
POINTING = {"strong": 0.6, "weak": 0.35}
"""Cosine of what a text says of a thing beyond what all texts say, and what the thing's pictures say."""


@dataclass(frozen=True, kw_only=True)
class Named:
    """One name: how probably the likeliest object is meant, and whether it is."""

    probability: float
    is_right: bool
    is_mapped: bool


def named_on_map(gallery: Gallery, pointing: str, seed: int) -> list[Named]:
    """Every name asked of one map; half of them are of nothing on it."""
    random = keyed_generator("embeddings", "texts", pointing, seed)
    things = [gallery.things[number] for number in random.permutation(len(gallery.things))[:NUM_NAMES]]
    views = []
    for number, thing in enumerate(things[:NUM_MAPPED]):
        for row in random.permutation(len(thing.azimuths))[:VIEWS]:
            place = CameraPlaces.one(float(thing.azimuths[row]), 0.0)
            views.append(SeenView(object_id=number, vector=thing.vectors[row], place=place))
    looks = Appearances.of(views, [], SemanticModelConfiguration())
    means = np.array([thing.vectors.mean(axis=0) for thing in things])
    texts = dict(zip((thing.name for thing in things), _texts(means, POINTING[pointing], random), strict=True))
    known, found = map_of(NUM_MAPPED), []
    for number, thing in enumerate(things):
        best = find_objects(known, Question(name=thing.name, text_vectors=texts), looks).objects[0]
        found.append(
            Named(probability=best.probability, is_right=best.object_id == number, is_mapped=number < NUM_MAPPED)
        )
    return found


def _texts(means: Array, pointing: float, random: np.random.Generator) -> Array:
    """(N, F) vectors in a cone of their own."""
    about = means - means.mean(axis=0)
    about /= np.linalg.norm(about, axis=1, keepdims=True)
    noise = random.normal(size=about.shape) / np.sqrt(about.shape[1])
    cone = random.normal(size=about.shape[1]) / np.sqrt(about.shape[1])
    return np.asarray(cone + 0.5 * (pointing * about + np.sqrt(1.0 - pointing**2) * noise))


def scores(found: list[Named]) -> dict[str, float]:
    """Metrics of all names."""
    probability = np.array([own.probability for own in found])
    right = np.array([own.is_right for own in found])
    mapped = np.array([own.is_mapped for own in found])
    both = np.column_stack([probability, 1.0 - probability])
    return {
        "num_questions": len(found),
        "right": float(((probability > 0.5) == mapped)[~mapped | right].sum() / len(found)),
        "right_mapped": float((right & (probability > 0.5))[mapped].mean()),
        "right_not_mapped": float((probability <= 0.5)[~mapped].mean()),
        "ece": expected_calibration_error(both, (~right).astype(int)),
    }
