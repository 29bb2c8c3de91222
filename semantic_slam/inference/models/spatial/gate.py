"""Gating bound in space: least cost of associating a detection with an object whose position is uncertain."""

import numpy as np

from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.models.spatial.detection import SpatialDetections
from semantic_slam.inference.models.spatial.ray import polar


def least_cost(detections: SpatialDetections, covariance: Array, body: Array, sigmas: Array) -> tuple[Array, float]:
    """(P, D, O) lower bound [nats] on the cost of D detections, the larger of those by range and by ray.

    ``body`` (P, O, 3) objects in the body frames of P robots of (P, 6, 6) ``covariance``; ``sigmas`` (O,) [m] of the
    objects' positions. Also the log of the densities' peaks. A position error r changes a distance d by at most r and,
    while r < d, a direction by asin(r / d) <= pi r / 2d; a rotation of the robot changes it by its angle at most, and
    shifts the camera of a ray alone by that angle times its distance from the body. Errors of robot and object may be
    correlated: their standard deviations add up.
    """
    turn, place = (largest_sigmas(covariance[:, rows, rows]) for rows in (se3.ROTATION, se3.TRANSLATION))
    position = place[:, None, None] + sigmas  # (P, 1, O)
    shifted = position + turn[:, None, None] * np.sqrt(squared_norms(detections.origin))[:, None]  # (P, D, O)
    seen = body[:, None] - detections.origin[:, None]
    off = polar(seen, detections.ray[:, None], detections.basis[:, None])  # (P, D, O, 3)
    whiten, ranged = detections.whiten.copy(), detections.has_range
    whiten[~ranged, 0, 0] = 1.0
    noise = np.linalg.inv(whiten)
    spread = np.asarray(noise @ np.swapaxes(noise, 1, 2), dtype=np.float64)
    by_range = (
        ranged[:, None] * (off[..., 0] - detections.range_m[:, None]) ** 2 / (position**2 + spread[:, 0, 0, None])
    )
    across = largest_sigmas(spread[:, 1:, 1:])[:, None]
    sigma = turn[:, None, None] + 0.5 * np.pi * shifted / off[..., 0]
    by_ray = squared_norms(off[..., 1:]) / (sigma**2 + across**2)
    by_ray = np.minimum(by_ray, (off[..., 0] / shifted) ** 2)  # or the robot is anywhere around the object
    return 0.5 * np.maximum(by_range, by_ray), float(detections.log_normaliser.sum())
