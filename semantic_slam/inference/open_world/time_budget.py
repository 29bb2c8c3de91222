"""A time budget per keyframe, kept by limiting the number of hypotheses."""

import time
from dataclasses import replace

from semantic_slam.configuration import PruningConfiguration


class TimeBudget:
    """Limits the number of hypotheses by the time per keyframe; ``budget_ms`` 0: no limit, and no clock is read."""

    def __init__(self, budget_ms: float, limits: PruningConfiguration):
        self._limits = limits
        self.set(budget_ms)
        self._per_hypothesis_s = 0.0
        self._begun_s = 0.0

    def set(self, budget_ms: float) -> None:
        """Use another budget from the next keyframe on."""
        self._budget_s = budget_ms / 1e3

    @property
    def is_on(self) -> bool:
        return self._budget_s > 0.0

    def begin(self) -> None:
        """Start timing a keyframe."""
        if self.is_on:
            self._begun_s = time.perf_counter()

    def limits(self) -> PruningConfiguration:
        """Pruning limits for now: as many hypotheses as fit the budget at the time per hypothesis so far."""
        if not self.is_on or self._per_hypothesis_s <= 0.0:
            return self._limits
        affordable = max(1, int(self._budget_s / self._per_hypothesis_s))
        return replace(self._limits, max_hypotheses=min(affordable, self._limits.max_hypotheses))

    def end(self, num_hypotheses: int) -> None:
        """Stop timing a keyframe; the time per hypothesis is smoothed over about five keyframes."""
        if self.is_on:
            taken = (time.perf_counter() - self._begun_s) / num_hypotheses
            known = self._per_hypothesis_s
            self._per_hypothesis_s = taken if known == 0.0 else 0.8 * known + 0.2 * taken
