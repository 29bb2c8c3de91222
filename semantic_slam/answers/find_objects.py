"""``find_objects``: objects of a map that match a query; used by all commands and services."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.answers.appearances import Appearances
from semantic_slam.answers.by_text import meant_by
from semantic_slam.answers.by_vector import shown_by
from semantic_slam.answers.question import Question
from semantic_slam.answers.region import inside
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.belief import HybridBelief


@dataclass(frozen=True, kw_only=True)
class FoundObject:
    """An object with the probability that it exists, matches the query and lies in the region."""

    object_id: int
    name: str
    probability: float
    pose: Array  # (7,) in map
    covariance: Array  # (6, 6) along the axes of map


@dataclass(frozen=True, kw_only=True)
class Found:
    """Query result: objects with at least the requested probability, most likely first."""

    objects: tuple[FoundObject, ...]
    unknown: float  # probability that no object in the region matches


def find_objects(belief: HybridBelief, question: Question, looks: Appearances | None = None) -> Found:
    """Find matching objects in a belief; vector queries need their appearances ``looks``. Raises InputError.

    A vector shows one object: the probabilities of the objects sum to 1 - unknown. A name may match many: then unknown
    is the probability that none matches, and 1 - unknown that at least one does. For a class it is that over the
    hypotheses, and within each, as for a name with text vectors, objects match independently of each other.
    """
    existence = np.clip(np.nan_to_num(belief.existence), 0.0, 1.0)
    in_region = inside(belief, question.region)
    probabilities = _probabilities(belief, question, looks, existence) * in_region
    if question.vector is not None:
        unknown = 1.0 - probabilities.sum()
    elif question.text_vectors:
        unknown = np.prod(1.0 - probabilities)
    else:
        unknown = _none_of_class(belief, question.name, existence * in_region)
    rows = [
        row for row in np.argsort(-probabilities, kind="stable") if probabilities[row] >= question.least_probability
    ]
    return Found(
        objects=tuple(
            FoundObject(
                object_id=int(belief.object_ids[row]),
                name=belief.object_names[row],
                probability=float(probabilities[row]),
                pose=belief.object_poses[row],
                covariance=belief.object_covariances[row],
            )
            for row in rows
        ),
        unknown=float(np.clip(unknown, 0.0, 1.0)),
    )


def _probabilities(belief: HybridBelief, question: Question, looks: Appearances | None, existence: Array) -> Array:
    """(O,) probabilities that objects exist and match."""
    ids: Index = belief.object_ids.astype(np.intp)
    if question.vector is not None or question.text_vectors:
        if looks is None:
            raise InputError("nothing is known of what the objects look like; give a belief bag with its measurements")
        if question.vector is not None:
            return shown_by(question.vector, ids, existence, looks, question.mapped)[:-1]
        meant = meant_by(question.name, question.text_vectors, ids, existence, looks, question.mapped)
        return np.asarray(existence * meant)
    return np.asarray(existence * _of_class(belief, question.name))


def _none_of_class(belief: HybridBelief, name: str, here: Array) -> float:
    """Probability that no object is of a class: the mean over the hypotheses, each with its own class probabilities.

    Where hypotheses take one object or the other for the only chair, there is one in all of them. ``here`` (O,) is the
    probability of each object that it exists and lies in the region, which beliefs do not state by hypothesis.
    """
    of_class = np.nan_to_num(belief.hypothesis_class_probabilities[:, :, belief.class_names.index(name)])  # (H, O)
    return float(np.exp(belief.log_weights) @ np.prod(1.0 - here * of_class, axis=1))


def _of_class(belief: HybridBelief, name: str) -> Array:
    """(O,) probabilities of a class. Raises InputError for a class unknown to the belief."""
    if name not in belief.class_names:
        known = ", ".join(belief.class_names) or "none: its class models name no classes"
        raise InputError(
            f"'{name}' is no class of the map, which knows {known}; ask for one of these, or give text vectors"
        )
    return np.asarray(np.nan_to_num(belief.class_probabilities[:, belief.class_names.index(name)]))
