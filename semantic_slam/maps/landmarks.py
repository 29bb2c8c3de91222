"""The objects of one of two maps that are compared: where they are relative to each other, and how surely."""

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
"""Existence from which on an object is compared."""
LEAST_CLASS_SHARE = 0.001
"""Share of the uniform distribution in what is known of a class: one sure object of a thousand is of another."""


@dataclass(frozen=True, kw_only=True)
class Landmarks:
    """n objects of a map; C classes that both maps know."""

    rows: Index  # (n,) in the map
    ids: Index  # (n,)
    states: Array  # (n, 3) x, y, yaw in the map's frame
    covariances: Array  # (n, 3, 3) without the error that they have in common, along the axes of map
    frame: Array  # (3, 3) covariance of that error: a shift, and a turn about ``centre``
    centre: Array  # (2,)
    existence: Array  # (n,)
    classes: Array  # (n, C) probabilities by what was seen of each object alone, all classes as likely before
    descriptors: Array  # (n, L) NaN where not known
    descriptor_variances: Array  # (n, L)

    @classmethod
    def of(cls, known: SavedMap, class_names: Sequence[str], rows: Index) -> "Landmarks":
        """Some objects of a map, with the classes in this order."""
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
    """Rows of the objects of a map that are compared."""
    return np.flatnonzero(known.objects.existence >= LEAST_EXISTENCE)


def frame_slopes(states: Array, centre: Array) -> Array:
    """(n, 3, 3) how x, y, yaw of n states change with a shift, and a turn about ``centre``."""
    slopes = np.tile(np.eye(3), (len(states), 1, 1))
    slopes[:, 0, 2], slopes[:, 1, 2] = -(states[:, 1] - centre[1]), states[:, 0] - centre[0]
    return slopes


def turned(states: Array, covariances: Array, T: Array) -> tuple[Array, Array]:
    """States (n, 3) and (n, 3, 3) along the axes of their frame, in the frame in which theirs is at ``T`` (3,)."""
    cos, sin = np.cos(T[2]), np.sin(T[2])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return se2.compose(np.broadcast_to(T, states.shape), states), turn @ covariances @ turn.T


def _without_frame(states: Array, joint: Array) -> tuple[Array, Array, Array]:
    """(n, 3, 3) covariances relative to the other objects, and (3, 3) of what all have in common, about a centre."""
    blocks = joint.reshape(len(states), 3, len(states), 3)
    variances = np.maximum(np.einsum("iaia->ia", blocks), 1e-9)
    weights = 1.0 / variances
    weights[:, 2] = 0.0 if len(states) > 1 else 1.0  # places tell how a map is turned
    places = weights[:, :2].sum(axis=1)
    centre = places @ states[:, :2] / places.sum()
    slopes = frame_slopes(states, centre).reshape(-1, 3)
    fit = np.linalg.pinv(slopes.T @ (weights.ravel()[:, None] * slopes)) @ (slopes.T * weights.ravel())
    frame = fit @ joint @ fit.T
    kept = np.eye(len(joint)) - slopes @ fit
    relative = (kept @ joint @ kept.T).reshape(blocks.shape)
    return np.einsum("iaib->iab", relative), frame, centre
