"""Mean and covariance of a Gaussian mixture over poses."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def matched_moments(weights: Array, poses: Array, covariances: Array) -> tuple[Array, Array]:
    """(7,) pose and (6, 6) covariance of the Gaussian with the mixture's moments.

    ``poses`` (H, 7) and ``covariances`` (H, 6, 6; x y z rx ry rz along fixed axes) are those of the components.
    Components without the pose (NaN) are left out and the others renormalised; with none left all is NaN.
    """
    present = np.isfinite(poses).all(-1) & (weights > 0.0)
    if not present.any():
        return np.full(7, np.nan), np.full((6, 6), np.nan)
    weights, poses, covariances = weights[present] / weights[present].sum(), poses[present], covariances[present]
    if len(weights) == 1:
        return poses[0], covariances[0]
    rotations = Rotation.from_quat(poses[:, 3:])
    mean_rotation = rotations.mean(weights)
    position = weights @ poses[:, :3]
    deviation = np.hstack([poses[:, :3] - position, (rotations * mean_rotation.inv()).as_rotvec()])
    spread = np.einsum("h,hi,hj->ij", weights, deviation, deviation)
    covariance = np.einsum("h,hij->ij", weights, covariances) + spread
    return np.concatenate([position, mean_rotation.as_quat(canonical=True)]), covariance
