"""Objects of a map prepared for comparison: relative positions and their uncertainties; F as in :mod:`frames`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.maps.as_prior import joint_covariance
from semantic_slam.maps.class_priors import class_evidence
from semantic_slam.maps.frames import MapFrames
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
    frames: MapFrames
    states: Array  # (n, 3) coordinates in the map's frame
    covariances: Array  # (n, 3, 3) without their common error, in the map frame
    frame: Array  # (F, F) covariance of the common error: a shift, and a rotation about ``centre``
    centre: Array  # (2,)
    existence: Array  # (n,)
    classes: Array  # (n, C) class probabilities from each object's own evidence, with a uniform prior
    descriptors: Array  # (n, L) NaN where not known
    descriptor_variances: Array  # (n, L)

    @classmethod
    def of(cls, known: SavedMap, class_names: Sequence[str], rows: Index) -> "Landmarks":
        """Selected objects of a map, with the classes in the given order."""
        frames = MapFrames(known.coordinates)
        states = known.coordinates.of_poses(known.objects.poses[rows])
        own = known.coordinates.of_covariances(known.objects.covariances)
        if known.has_cross_covariances:
            joint = joint_covariance(known)
        else:
            joint = np.zeros((3 * len(own), 3 * len(own)))
            for row, block in enumerate(own):
                joint[3 * row : 3 * row + 3, 3 * row : 3 * row + 3] = block
        places = (3 * rows[:, None] + np.arange(3)).ravel()
        relative, frame, centre = _without_frame(frames, states, joint[np.ix_(places, places)])
        columns = [known.class_names.index(name) for name in class_names]
        classes = class_evidence(known.objects)[np.ix_(rows, np.array(columns, dtype=int))]
        share = LEAST_CLASS_SHARE / max(len(columns), 1)
        return cls(
            rows=rows,
            ids=known.objects.ids[rows],
            frames=frames,
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


def turned(known: Landmarks, T: Array) -> tuple[Array, Array]:
    """States (n, 3) and covariances (n, 3, 3) in the frame that has theirs at ``T`` (F,)."""
    turn = known.frames.turn(T)
    return known.frames.moved(T, known.states), turn @ known.covariances @ turn.T


def _without_frame(frames: MapFrames, states: Array, joint: Array) -> tuple[Array, Array, Array]:
    """Split off the common frame error: (n, 3, 3) relative covariances, (F, F) common covariance, and its centre."""
    blocks = joint.reshape(len(states), 3, len(states), 3)
    variances = np.maximum(np.einsum("iaia->ia", blocks), 1e-9)
    weights = 1.0 / variances
    if frames.coordinates.has_yaw:
        weights[:, 2] = 0.0 if len(states) > 1 else 1.0  # positions determine the rotation
    places = weights[:, :2].sum(axis=1)
    centre = places @ states[:, :2] / places.sum()
    slopes = frames.slopes(states, centre).reshape(-1, frames.size)
    fit = np.linalg.pinv(slopes.T @ (weights.ravel()[:, None] * slopes)) @ (slopes.T * weights.ravel())
    frame = fit @ joint @ fit.T
    kept = np.eye(len(joint)) - slopes @ fit
    relative = (kept @ joint @ kept.T).reshape(blocks.shape)
    return np.einsum("iaib->iab", relative), frame, centre
