"""Limit of the candidates of one hypothesis, such that crowded keyframes take bounded work."""

from semantic_slam.configuration import WeightsConfiguration

LEAST_CANDIDATES = 8
"""Candidates of one hypothesis, however many detections there are."""


def candidate_limit(weights: WeightsConfiguration, num_detections: int) -> int:
    """Most candidates of one hypothesis in a keyframe with that many detections.

    The detections in all its candidates are at most ``weights.max_associations``. What is not enumerated counts in the
    mass left out.
    """
    if not weights.max_associations:
        return weights.max_candidates
    bounded = weights.max_associations // max(num_detections, 1)
    return min(weights.max_candidates, max(bounded, LEAST_CANDIDATES))
