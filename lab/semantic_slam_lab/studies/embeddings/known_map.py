"""A map whose objects are all there: what a question by vectors asks of a belief."""

import numpy as np

from semantic_slam.inference.belief import HybridBelief


def map_of(count: int) -> HybridBelief:
    """``count`` objects that exist for certain, with their numbers for ids."""
    poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (count, 1))
    poses[:, 0] = np.arange(count)
    return HybridBelief(
        stamp_ns=0,
        keyframe=0,
        planar=True,
        class_names=(),
        num_candidates=1,
        hypothesis_ids=np.ones(1, dtype=np.uint64),
        parent_ids=np.zeros(1, dtype=np.uint64),
        modes=np.zeros(1, dtype=np.uint16),
        log_weights=np.zeros(1),
        poses=poses[:1],
        pose_covariances=1e-4 * np.eye(6)[None],
        detection_ids=np.zeros(0, dtype=np.uint32),
        associations=np.zeros((1, 0), dtype=np.int32),
        object_ids=np.arange(count, dtype=np.uint32),
        object_names=tuple(str(number) for number in range(count)),
        hypothesis_class_probabilities=np.zeros((1, count, 0)),
        association_entropy=0.0,
        component_entropy=0.0,
        discarded_mass=0.0,
        existence=np.ones(count),
        class_probabilities=np.zeros((count, 0)),
        object_poses=poses,
        object_covariances=np.tile(1e-4 * np.eye(6), (count, 1, 1)),
        mutual_information=np.full(count, np.nan),
        in_coverage=np.ones(count, dtype=np.bool_),
        forgotten_views=np.zeros(count, dtype=np.uint32),
        descriptors=np.zeros((count, 0)),
        descriptor_covariances=np.zeros((count, 0)),
        dropped=0,
    )
