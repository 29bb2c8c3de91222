"""Non-maximum suppression of boxes."""

import numpy as np

from semantic_slam.geometry.arrays import Array, Index


def without_overlaps(boxes: Array, scores: Array, largest_overlap: float) -> Index:
    """Rows of (N, 4) boxes that overlap no better one by more than that IoU, the best of (N,) scores first."""
    area = np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1)
    left = np.argsort(-scores, kind="stable")
    left, kept = left[area[left] > 0.0], []
    while len(left):
        best, rest = left[0], left[1:]
        kept.append(best)
        shared = np.minimum(boxes[best, 2:], boxes[rest, 2:]) - np.maximum(boxes[best, :2], boxes[rest, :2])
        both = np.prod(np.maximum(shared, 0.0), axis=1)
        left = rest[both <= largest_overlap * (area[best] + area[rest] - both)]
    return np.array(kept, dtype=np.intp)
