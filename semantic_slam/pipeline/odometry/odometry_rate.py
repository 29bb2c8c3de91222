"""How often odometry comes and how fast the robot moves, which tell whether it is missing, and what that may hide.

Between two samples that are as close as usual the motion is steady. Where odometry is missing for longer, the robot may
have stood until the gap's end or have moved at once: within a gap from a to b its place at t is that of steady motion,
with a standard deviation of pace * min(t - a, b - t); both ends are as sure as ever.
"""

from collections import deque
from dataclasses import dataclass
from statistics import median

from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.stamps.topic_clock import LEAP_STEPS

RECENT_STEPS = 25
"""So many last steps tell the rate and the pace."""
LEAST_STEPS = 3
"""With fewer the rate is not known, and nothing is called a gap."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """What the last steps of odometry were like."""

    step_s: float = 0.0  # median; 0: not known yet
    pace_m_s: float = 0.0
    pace_rad_s: float = 0.0

    def is_gap(self, step_s: float) -> bool:
        """Whether a step is longer than the rate allows."""
        return 0.0 < LEAP_STEPS * self.step_s < step_s


NOT_KNOWN = Rate()


class RateMeter:
    """Follows the odometry, sample by sample."""

    def __init__(self) -> None:
        self._steps: deque[tuple[float, float, float]] = deque(maxlen=RECENT_STEPS)  # duration [s], length [m], turn

    def step(self, duration_ns: int, length_m: float, turn_rad: float) -> Rate:
        """The rate with one more step. Gaps tell nothing of it, nor does a step back from a stamp that was wrong."""
        duration_s = duration_ns / NANOSECONDS
        if duration_ns > 0 and not self._rate().is_gap(duration_s):
            self._steps.append((duration_s, length_m, turn_rad))
        return self._rate()

    def _rate(self) -> Rate:
        if len(self._steps) < LEAST_STEPS:
            return NOT_KNOWN
        durations, lengths, turns = zip(*self._steps, strict=True)
        whole_s = sum(durations)
        return Rate(step_s=median(durations), pace_m_s=sum(lengths) / whole_s, pace_rad_s=sum(turns) / whole_s)
