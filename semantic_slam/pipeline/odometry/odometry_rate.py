"""Rate of the odometry and pace of the robot, for detecting gaps in odometry and bounding the motion within them.

Between two samples at the usual distance constant velocity is assumed. In a longer gap, from a to b, the robot may have
moved at any time: its pose at t is interpolated at constant velocity, with an additional standard deviation of
pace * min(t - a, b - t), which is zero at both ends.

No robot makes a step that is a jump: it tells nothing of the motion meanwhile, as if odometry had been missing.
"""

from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import ClassVar

from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.stamps.topic_clock import LEAP_STEPS

RECENT_STEPS = 25
"""Number of last steps from which rate and pace are computed."""
LEAST_STEPS = 3
"""With fewer steps the rate is unknown, and no step is a gap or a jump."""
FASTEST_M_S, FASTEST_RAD_S = 50.0, 50.0
"""Speed and turn rate beyond which a step is a jump."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Typical step and pace of the last odometry samples."""

    step_s: float = 0.0  # median; 0: unknown yet
    pace_m_s: float = 0.0
    pace_rad_s: float = 0.0

    def is_gap(self, step_s: float) -> bool:
        """Whether a step is longer than ``LEAP_STEPS`` typical ones."""
        return 0.0 < LEAP_STEPS * self.step_s < step_s

    def is_jump(self, step_s: float, length_m: float, turn_rad: float) -> bool:
        """Whether no robot makes that step; steps shorter than the typical one have coarse stamps and count as one."""
        if self.step_s <= 0.0:
            return False
        duration_s = max(step_s, self.step_s)
        return length_m > FASTEST_M_S * duration_s or turn_rad > FASTEST_RAD_S * duration_s


NOT_KNOWN = Rate()


class RateMeter:
    """Estimates the rate from successive odometry steps."""

    STATE: ClassVar[tuple[str, ...]] = ("_steps",)

    def __init__(self) -> None:
        self._steps: deque[tuple[float, float, float]] = deque(maxlen=RECENT_STEPS)  # duration [s], length [m], turn

    def step(self, duration_ns: int, length_m: float, turn_rad: float) -> Rate:
        """Add a step and return the rate; gaps, and steps back in time after a wrong stamp, are not included."""
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
