"""Objects of a map prepared for comparison: relative positions and their uncertainties."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector
from semantic_slam.maps.as_prior import joint_covariance
from semantic_slam.maps.class_priors import class_evidence
from semantic_slam.maps.saved_map import SavedMap

LEAST_EXISTENCE = 0.05
"""Smallest existence probability of a compared object."""
LEAST_CLASS_SHARE = 0.001
"""Weight of the uniform distribution mixed into class probabilities: 1 in 1000 certain classes is wrong."""


@dataclass(frozen=True, kw_only=True)
class Landmarks:
    """n objects of a map; C classes known to both maps."""

    rows: Index  # (n,) in the map
    ids: Index  # (n,)
    states: Array  # (n, 3) x, y, yaw in the map's frame
    covariances: Array  # (n, 3, 3) without their common error, in the map frame
    frame: Array  # (3, 3) covariance of the common error: a shift, and a rotation about ``centre``
    centre: Array  # (2,)
    existence: Array  # (n,)
    classes: Array  # (n, C) class probabilities from each object's own evidence, with a uniform prior
    descriptors: Array  # (n, L) NaN where not known
    descriptor_variances: Array  # (n, L)

    @classmethod
    def of(cls, known: SavedMap, class_names: Sequence[str], rows: Index) -> "Landmarks":
        """Selected objects of a map, with the classes in the given order."""
        states = planar_from_pose_vector(known.objects.poses[rows])
        own = planar_from_covariance(known.objects.covariances)
        if known.has_cross_covariances:
            joint = joint_covariance(known)
        else:
            joint = np.zeros((3 * len(own), 3 * len(own)))
            for row, block in enumerate(own):
                joint[3 * row : 3 * row + 3, 3 * row : 3 * row + 3] = block
        places = (3 * rows[:, None] + np.arange(3)).ravel()
        relative, frame, centre = _without_frame(states, joint[np.ix_(places, places)])
        columns = [known.class_names.index(name) for name in class_names]
        classes = class_evidence(known.objects)[np.ix_(rows, np.array(columns, dtype=int))]
        share = LEAST_CLASS_SHARE / max(len(columns), 1)
        return cls(
            rows=rows,
            ids=known.objects.ids[rows],
            states=states,
            covariances=relative,
            frame=frame,
            centre=centre,
            existence=known.objects.existence[rows],
            classes=(1.0 - LEAST_CLASS_SHARE) * classes + share,
            descriptors=known.objects.descriptors[rows],
            descriptor_variances=known.objects.descriptor_variances[rows],
        )

    def __len__(self) -> int:
        return len(self.rows)


def compared_rows(known: SavedMap) -> Index:
    """Rows of the map objects to compare."""
    return np.flatnonzero(known.objects.existence >= LEAST_EXISTENCE)


def frame_slopes(states: Array, centre: Array) -> Array:
    """(n, 3, 3) Jacobians of x, y, yaw of n states by a shift, and a rotation about ``centre``."""
    slopes = np.tile(np.eye(3), (len(states), 1, 1))
    slopes[:, 0, 2], slopes[:, 1, 2] = -(states[:, 1] - centre[1]), states[:, 0] - centre[0]
    return slopes


def turned(states: Array, covariances: Array, T: Array) -> tuple[Array, Array]:
    """Transform states (n, 3) and covariances (n, 3, 3) by ``T`` (3,), the pose of their frame in the target frame."""
    cos, sin = np.cos(T[2]), np.sin(T[2])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return se2.compose(np.broadcast_to(T, states.shape), states), turn @ covariances @ turn.T


def _without_frame(states: Array, joint: Array) -> tuple[Array, Array, Array]:
    """Split off the common frame error: (n, 3, 3) relative covariances, (3, 3) common covariance, and its centre."""
    blocks = joint.reshape(len(states), 3, len(states), 3)
    variances = np.maximum(np.einsum("iaia->ia", blocks), 1e-9)
    weights = 1.0 / variances
    weights[:, 2] = 0.0 if len(states) > 1 else 1.0  # positions determine the rotation
    places = weights[:, :2].sum(axis=1)
    centre = places @ states[:, :2] / places.sum()
    slopes = frame_slopes(states, centre).reshape(-1, 3)
    fit = np.linalg.pinv(slopes.T @ (weights.ravel()[:, None] * slopes)) @ (slopes.T * weights.ravel())
    frame = fit @ joint @ fit.T
    kept = np.eye(len(joint)) - slopes @ fit
    relative = (kept @ joint @ kept.T).reshape(blocks.shape)
    return np.einsum("iaib->iab", relative), frame, centre
