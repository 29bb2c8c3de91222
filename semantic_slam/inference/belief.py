"""The hybrid belief as it leaves the engine: Eq. 4.4 after one keyframe."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class HybridBelief:
    """H hypotheses, D detections, O objects, C classes, L descriptor dimensions. Field by field HybridBelief.msg."""

    stamp_ns: int
    keyframe: int
    planar: bool
    class_names: tuple[str, ...]  # (C,)
    num_candidates: int
    hypothesis_ids: NDArray[np.uint64]  # (H,)
    parent_ids: NDArray[np.uint64]  # (H,)
    modes: NDArray[np.uint16]  # (H,)
    log_weights: Array  # (H,) normalised natural logs
    poses: Array  # (H, 7) robot in map
    pose_covariances: Array  # (H, 6, 6)
    detection_ids: NDArray[np.uint32]  # (D,)
    associations: NDArray[np.int32]  # (H, D) index into object_ids, -1 clutter
    object_ids: NDArray[np.uint32]  # (O,)
    object_names: tuple[str, ...]  # (O,)
    hypothesis_class_probabilities: Array  # (H, O, C)
    existence: Array  # (O,)
    class_probabilities: Array  # (O, C)
    object_poses: Array  # (O, 7)
    object_covariances: Array  # (O, 6, 6)
    mutual_information: Array  # (O,) nats
    in_coverage: NDArray[np.bool_]  # (O,)
    forgotten_views: NDArray[np.uint32]  # (O,)
    descriptors: Array  # (O, L)
    descriptor_covariances: Array  # (O, L)
    association_entropy: float  # nats
    component_entropy: float  # nats
    discarded_mass: float
    dropped: int
    num_merged: int = 0  # near copies that gave their weight to a heavier hypothesis in this keyframe
    reproducible: bool = True  # no clock had a say
