"""Detection probabilities of objects of poorly known range, given that they were detected.

The evidence of a pair is its density times the mean detection probability over the posterior given that pair. Where an
object was first seen along a ray alone, that is not the mean over the prediction: much of the ray may be out of view,
but what was detected is in the image, and nothing occludes it.
"""

import numpy as np
from scipy.special import ndtr

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.models.spatial.ray import distances
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.open_world.spatial.region import LEAST_SIGMA
from semantic_slam.inference.states.views import Looks


def seen_again(prediction: Prediction, rows: Assignments, object_ids: Index, looks: Looks) -> Looks:
    """The ``looks`` from K modes, with detected objects that were first seen along a ray alone in view.

    ``rows`` K candidates that associate detections with ``object_ids`` (K, D). Only the limits of the range count: its
    error is Gaussian, as at the candidate's mode.
    """
    if prediction.anchors is None:
        return looks
    along = prediction.near_ids[np.isfinite(prediction.anchors).all(axis=1)]
    reached = prediction.component.objects.ids[prediction.in_reach]
    candidates, numbers = np.nonzero(np.isin(object_ids, along) & np.isin(object_ids, reached))
    if not len(candidates):
        return looks
    region, rates = prediction.region, prediction.rates
    camera = region.camera.on(rows.column("robot")[candidates])[:, :3]
    away = rows.column("object_states")[candidates, numbers][:, :3] - camera
    reach = distances(away)
    unit, covariance = away / reach[:, None], rows.column("object_covariances")[candidates, numbers]
    sigma = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", unit, covariance, unit), 0.0)) + LEAST_SIGMA
    inside = ndtr((region.max_range_m - reach) / sigma) - ndtr((region.min_range_m - reach) / sigma)
    chance = rates.probability * rates.fall_off(reach)
    places = candidates, np.searchsorted(reached, object_ids[candidates, numbers])
    if looks.detectable is not None:
        chance = chance * looks.detectable[places] / rates.runs.share
    in_view, found = looks.in_view.copy(), looks.chance.copy()
    in_view[places], found[places] = inside[:, None], chance
    return looks._replace(in_view=in_view, chance=found)
