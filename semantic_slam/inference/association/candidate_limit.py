"""Limit of the candidates of one hypothesis, such that crowded keyframes take bounded work."""

from semantic_slam.configuration import PruningConfiguration, WeightsConfiguration

LEAST_CANDIDATES = 8
"""Candidates of one hypothesis, however many detections there are."""


def candidate_limit(weights: WeightsConfiguration, pruning: PruningConfiguration, num_detections: int) -> int:
    """Most candidates of one hypothesis in a keyframe with that many detections.

    It depends on nothing but the configuration and the keyframe, whichever hypotheses are live and wherever they are
    held: with ``pruning.max_hypotheses`` of them the associations of detections in all candidates are at most
    ``weights.max_associations``. What is not enumerated counts in the mass left out.
    """
    if not weights.max_associations:
        return weights.max_candidates
    per_hypothesis = weights.max_associations // (pruning.max_hypotheses * max(num_detections, 1))
    return min(weights.max_candidates, max(per_hypothesis, LEAST_CANDIDATES))
