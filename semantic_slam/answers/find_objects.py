"""``find_objects``: the objects of a map that are probably what is looked for. Commands and services all ask here."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import multivariate_normal

from semantic_slam.answers.appearances import Appearances
from semantic_slam.answers.by_text import meant_by
from semantic_slam.answers.by_vector import shown_by
from semantic_slam.answers.question import Question
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.belief import HybridBelief


@dataclass(frozen=True, kw_only=True)
class FoundObject:
    """An object, and how probably it exists, is what is looked for, and lies in the region that is asked for."""

    object_id: int
    name: str
    probability: float
    pose: Array  # (7,) in map
    covariance: Array  # (6, 6) along the axes of map


@dataclass(frozen=True, kw_only=True)
class Found:
    """Objects with the probability asked for at least, the likeliest first."""

    objects: tuple[FoundObject, ...]
    unknown: float  # of a picture: that it shows none of the objects; else that no object is what is looked for


def find_objects(belief: HybridBelief, question: Question, looks: Appearances | None = None) -> Found:
    """What is looked for among the objects of a belief; vectors need the ``looks`` of these. Raises InputError.

    A vector shows one thing: the probabilities of the objects sum to 1 - unknown. A name may be that of many.
    """
    existence = np.clip(np.nan_to_num(belief.existence), 0.0, 1.0)
    probabilities, unknown = _probabilities(belief, question, looks, existence)
    probabilities = probabilities * _inside(belief, question)
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
        unknown=unknown,
    )


def _probabilities(
    belief: HybridBelief, question: Question, looks: Appearances | None, existence: Array
) -> tuple[Array, float]:
    """(O,) that objects exist and are meant, and that none is."""
    ids: Index = belief.object_ids.astype(np.intp)
    if question.vector is not None or question.text_vectors:
        if looks is None:
            raise InputError("nothing is known of what the objects look like; give a belief bag with its measurements")
        if question.vector is not None:
            shown = shown_by(question.vector, ids, existence, looks, question.mapped)
            return shown[:-1], float(shown[-1])
        meant: Array = existence * meant_by(
            question.name, question.text_vectors, ids, existence, looks, question.mapped
        )
    else:
        meant = existence * _of_class(belief, question.name)
    return meant, float(np.prod(1.0 - meant))


def _of_class(belief: HybridBelief, name: str) -> Array:
    """(O,) probabilities of a class. Raises InputError for one that the belief does not know."""
    if name not in belief.class_names:
        known = ", ".join(belief.class_names) or "none: its class models name no classes"
        raise InputError(
            f"'{name}' is no class of the map, which knows {known}; ask for one of these, or give text vectors"
        )
    return np.asarray(np.nan_to_num(belief.class_probabilities[:, belief.class_names.index(name)]))


def _inside(belief: HybridBelief, question: Question) -> Array:
    """(O,) probabilities that the objects lie in the region."""
    count = len(belief.object_ids)
    if question.region is None:
        return np.ones(count)
    lower, upper = np.array(question.region[:2]), np.array(question.region[2:])
    inside = np.zeros(count)
    for row in range(count):
        place, spread = belief.object_poses[row, :2], belief.object_covariances[row, :2, :2]
        if np.isfinite(place).all() and np.isfinite(spread).all():
            normal = multivariate_normal(place, spread, allow_singular=True)
            inside[row] = np.clip(normal.cdf(upper, lower_limit=lower), 0.0, 1.0)
    return inside
