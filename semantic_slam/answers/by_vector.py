"""Image queries by embedding: which object an image shows, its viewpoint being unknown."""

import numpy as np

from semantic_slam.answers.appearances import Appearances
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.viewpoint.embeddings.model import NUM_SECTORS, REMEMBERED_RAD, EmbeddingRecord


def shown_by(vector: Array, object_ids: Index, existence: Array, looks: Appearances, mapped: float) -> Array:
    """(O + 1,) probabilities that an (F,) vector shows each of O objects, and last none of them; they sum to 1.

    The shown object is on the map with prior probability ``mapped``, and then any object in proportion to its existence
    probability; an object may also be a false alarm with that appearance. For objects not on the map, and objects
    without vectors, the background is the density. Raises InputError for a vector of another network.
    """
    unit, nothing = looks.vector(vector), np.zeros(1)
    log_ratios = [
        _log_ratio(unit, looks.records[number], looks) if number in looks.records else nothing[0]
        for number in object_ids.tolist()
    ]
    weights = np.clip(np.nan_to_num(existence), 0.0, 1.0)
    if not weights.any():
        return np.append(weights, 1.0)
    joint = np.append(np.log(mapped / weights.sum()) + np.array(log_ratios), np.log1p(-mapped))
    shown = weights * np.exp(joint[:-1] - finite_log_sum_exp(joint))
    return np.append(shown, 1.0 - shown.sum())


def _log_ratio(unit: Array, record: EmbeddingRecord, looks: Appearances) -> float:
    """Log density of a view of an object relative to the background, averaged over viewing directions."""
    directions: Array = REMEMBERED_RAD * np.arange(NUM_SECTORS, dtype=np.float64)
    places = record.usual_places(directions)  # height and distance are unknown
    ratios = record.log_ratios(unit, looks.background, places)  # (R, M)
    average = finite_log_sum_exp(ratios) - np.log(NUM_SECTORS)
    return looks.model.evidence(record, average, looks.usual)
