"""Gating bound in the plane: least cost of associating a detection with an object whose position is uncertain."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import position_sigmas
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.planar.detection import PlanarDetections
from semantic_slam.inference.models.planar.polar import polar


def least_cost(detections: PlanarDetections, covariance: Array, body: Array, sigmas: Array) -> tuple[Array, float]:
    """(P, D, O) lower bound [nats] on the cost of D detections, the larger of those by range and by bearing.

    ``body`` (P, D, O, 2) objects in the body frames of P robots of (P, 3, 3) ``covariance``; ``sigmas`` (O,) [m] of the
    objects' positions. Also the log of the densities' peaks. A position error r changes a distance d by at most r and,
    while r < d, a direction by asin(r / d) <= pi r / 2 d. Errors of robot and object may be correlated: their standard
    deviations add up.
    """
    heading = np.sqrt(covariance[:, 2, 2])[:, None, None]  # (P, 1, 1)
    offset = np.hypot(*detections.origin.T)[:, None]  # (D, 1): a camera off the centre moves with the heading
    position = position_sigmas(covariance)[:, None, None] + sigmas + offset * heading  # (P, D, O)
    distance, bearing = polar(body - detections.origin[:, None])
    noise = np.linalg.inv(detections.whiten + (1.0 - detections.has_range)[:, None, None] * np.diag([1.0, 0.0]))
    variance = (noise @ np.swapaxes(noise, 1, 2)).diagonal(axis1=1, axis2=2)  # (D, 2)
    off = np.where(detections.has_range[:, None], distance - detections.range_m[:, None], 0.0)
    by_range = off**2 / (position**2 + variance[:, :1])
    turn = wrap_angle(bearing - detections.bearing_rad[:, None])
    by_bearing = turn**2 / ((heading + 0.5 * np.pi * position / distance) ** 2 + variance[:, 1:])
    by_bearing = np.minimum(by_bearing, (distance / position) ** 2)  # or the robot is anywhere around the object
    return 0.5 * np.maximum(by_range, by_bearing), float(detections.log_normaliser.sum())
