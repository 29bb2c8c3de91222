"""A keyframe as the engine sees it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.component import Motion, Observed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """One keyframe: motion since the one before, and D detections."""

    index: int
    stamp_ns: int
    motion: Motion
    detections: Sequence[Any]  # D, for the observation model
    detection_ids: NDArray[np.uint32]  # (D,) index in the detector's message
    scores: Array  # (D,) detector's confidence
    names: tuple[str, ...]  # (D,) identities given, "" for none
    in_coverage: NDArray[np.bool_]  # (D,) whether the view lay inside the class models' coverage
    dropped: int = 0  # inputs not used so far
    sight: Array = field(default_factory=lambda: np.zeros((0, 2)))  # (B, 2) bearing, range of the farthest surface

    def observed(self, association: Sequence[int], classes: Sequence[int], used: Iterable[int]) -> tuple[Observed, ...]:
        """The detections ``used`` that a hypothesis associates with objects."""
        return tuple(Observed(self.detections[i], association[i], classes[i]) for i in used if association[i] >= 0)
