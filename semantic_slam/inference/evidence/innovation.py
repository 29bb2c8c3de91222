"""Normalised innovation squared (NIS) of a keyframe's detections, jointly, under the prediction of a hypothesis."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem


def innovation_nees(problem: KeyframeProblem, y: Array, num_known: int) -> Array:
    """(B,) normalised innovation squared of range and bearing per degree of freedom, of B candidates.

    Residuals r and their Jacobian J are those at the whitened mode ``y`` (B, n): with the innovation r - J y at the
    prediction and its covariance S = I + J J^T it is nu^T S^-1 nu, as in an iterated Kalman filter, and at a mode of
    geometry alone twice the least energy. Detections of the first ``num_known`` objects count; the others, of objects
    that start here, and clutter do not. NaN where none counts.
    """
    objects = problem.rows.objects
    if not objects.shape[1]:
        return np.full(len(y), np.nan)
    residual, jacobian = problem.geometry_rows(y)
    counted = ((objects >= 0) & (objects < num_known))[..., None]
    jacobian = np.where(counted[..., None], jacobian, 0.0).reshape(len(y), -1, problem.size)
    shift = (jacobian @ y[..., None])[..., 0]
    innovation = np.where(counted, residual, 0.0).reshape(len(y), -1) - shift
    covariance = jacobian @ np.swapaxes(jacobian, 1, 2) + np.eye(innovation.shape[1])
    squared = (innovation * np.linalg.solve(covariance, innovation[..., None])[..., 0]).sum(axis=1)
    degrees = jacobian.any(axis=2).sum(axis=1)  # a row with a zero Jacobian measures nothing, e.g. a missing range
    return np.where(degrees > 0, squared / np.maximum(degrees, 1), np.nan)
