"""What a detection in space costs at least if it is of an object whose place is known that well."""

import numpy as np

from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.models.spatial.detection import SpatialDetections
from semantic_slam.inference.models.spatial.ray import polar


def least_cost(detections: SpatialDetections, covariance: Array, body: Array, sigmas: Array) -> tuple[Array, float]:
    """(P, D, O) nats of D detections, range and ray each on its own, at the deviation that makes it cheapest.

    ``body`` (P, O, 3) objects in the body frames of P robots of (P, 6, 6) ``covariance``; ``sigmas`` (O,) [m] of the
    objects' positions. And the log of the densities' peaks. A position that is off by r changes a distance d by at most
    r and, while r < d, a direction by asin(r / d) <= pi r / 2 d; a robot that is turned changes it by its turn at most.
    Deviations of robot and object may go together: their standard deviations add up.
    """
    turn, place = (largest_sigmas(covariance[:, rows, rows]) for rows in (se3.ROTATION, se3.TRANSLATION))
    position = place[:, None, None] + sigmas  # (P, 1, O)
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
    sigma = turn[:, None, None] + 0.5 * np.pi * position / off[..., 0]
    by_ray = squared_norms(off[..., 1:]) / (sigma**2 + across**2)
    by_ray = np.minimum(by_ray, (off[..., 0] / position) ** 2)  # or the robot is anywhere around the object
    return 0.5 * np.maximum(by_range, by_ray), float(detections.log_normaliser.sum())
