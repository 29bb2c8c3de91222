"""A detector's class scores as the semantic feature, where no classifier has measured one."""

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.measurement import SemanticMeasurements

REMEDY = "or set semantic_model.kind: none"


def score_features(measurements: SemanticMeasurements, names: tuple[str, ...]) -> Array:
    """(D, F) class scores in the order of the (F,) ``names`` of what the class models were fitted on.

    Nothing is learned of the detector: its scores must be those that the models describe. Raises InputError.
    """
    if not names:
        raise InputError(f"the class models do not name their features; give features instead of scores, {REMEDY}")
    given = measurements.class_names
    wanted = f"the class models know {', '.join(names)}"
    if not given:
        raise InputError(f"detections have no class scores; {wanted}: give the scores of these, {REMEDY}")
    unknown = [name for name in given if name not in names]
    if unknown:
        raise InputError(f"class score '{unknown[0]}' is of an unknown class; {wanted}: correct the name, {REMEDY}")
    missing = [name for name in names if name not in given]
    scores = measurements.class_scores[:, [given.index(name) for name in names if name in given]]
    if missing or np.isnan(scores).any():
        raise InputError(f"detections without a score for every class; {wanted}: give the scores of these, {REMEDY}")
    return np.asarray(scores)
