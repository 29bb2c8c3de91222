"""Odometry in stamp order, to be evaluated at any instant."""

from collections import Counter
from dataclasses import replace
from typing import ClassVar

from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.messages import topics
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.odometry.motion import OdometryPoint, driven_between, point_between, start
from semantic_slam.pipeline.odometry.odometry_path import OdometryPath
from semantic_slam.pipeline.odometry.odometry_rate import RateMeter
from semantic_slam.pipeline.stamps.stamped_buffer import StampedBuffer

MAX_EXTRAPOLATION_S = 1.0
"""How long after the last odometry sample, and before the first one, that one is used as the robot's pose [s].

Measurements farther outside the time of the odometry cannot be used.
"""

LEAST_TOLD_S = 2.0
"""Shortest gap that is told on the console [s]."""
MOST_TOLD = 5
"""Gaps that are told; a robot whose odometry comes now and then has many."""


class OdometryBuffer(StampedBuffer[OdometryPoint]):
    """Points of the odometry; samples are added and become points, of which those still needed are kept."""

    STATE: ClassVar[tuple[str, ...]] = (*StampedBuffer.STATE, "start", "_last", "_rates")

    def __init__(self, dropped: Counter[str], *, with_slopes: bool) -> None:
        """``dropped`` counts samples that are refused or jump; ``with_slopes``: see :func:`motion.start`."""
        super().__init__(topics.ODOMETRY, dropped, made_of=self._advanced)
        self.start: OdometryPoint | None = None  # at the first sample
        self._last: OdometryPoint | None = None
        self._rates = RateMeter()
        self._num_told, self._news = 0, list[str]()
        self._with_slopes = with_slopes

    def _advanced(self, sample: OdometrySample) -> OdometryPoint:
        """The point at the next sample."""
        last = self._last
        if last is not None and sample.stamp_ns <= last.stamp_ns:
            last, self._rates = self.newest, RateMeter()  # the first stamps were wrong and were withdrawn
        if last is None:
            self._last = self.start = start(sample, with_slopes=self._with_slopes)
        elif last.jumps_to(sample):
            self._dropped[f"{self.topic}: jumps farther than any robot moves"] += 1
            self._last = last.after_jump_to(sample)
        else:
            new = last.advance(sample)
            steps = (new.stamp_ns - last.stamp_ns, new.travelled_m - last.travelled_m, new.turned_rad - last.turned_rad)
            self._note_gap(last, steps[0] / NANOSECONDS)
            self._last = replace(new, rate=self._rates.step(*steps))
        return self._last

    def _note_gap(self, last: OdometryPoint, step_s: float) -> None:
        if step_s < LEAST_TOLD_S or not last.rate.is_gap(step_s) or self._num_told == MOST_TOLD:
            return
        self._num_told += 1
        more = "; further gaps are not told" if self._num_told == MOST_TOLD else ""
        self._news.append(
            f"{self.topic} is missing for {step_s:.1f} s from {last.stamp_ns / NANOSECONDS:.1f} s on; where keyframes"
            f" lie in such a gap, motion is uncertain: look for dropped messages{more}"
        )

    def news(self) -> list[str]:
        """Lines on the longer gaps, each once."""
        told, self._news = self._news, []
        return told

    def is_near(self, stamp_ns: int) -> bool:
        """Whether an instant is within the odometry, or at most ``MAX_EXTRAPOLATION_S`` outside it."""
        earlier, later = self.around(stamp_ns)
        if earlier is not None and later is not None:
            return True
        end = earlier or later
        return end is not None and abs(stamp_ns - end.stamp_ns) <= MAX_EXTRAPOLATION_S * NANOSECONDS

    def around(self, stamp_ns: int) -> tuple[OdometryPoint | None, OdometryPoint | None]:
        """The last point before an instant, and the first one at or after it."""
        earlier: OdometryPoint | None = None
        for sample_stamp_ns, point in self:
            if sample_stamp_ns >= stamp_ns:
                return earlier, point
            earlier = point
        return earlier, None

    def at(self, stamp_ns: int) -> OdometryPoint:
        """Odometry at an instant: interpolated; before the first sample the first, after the last one with sigmas."""
        earlier, later = self.around(stamp_ns)
        if earlier is not None and later is None:
            return earlier.standing_until(stamp_ns)
        return self.standing_at(stamp_ns)

    def standing_at(self, stamp_ns: int) -> OdometryPoint:
        """Odometry at an instant, interpolated; constant before the first sample and after the last."""
        earlier, later = self.around(stamp_ns)
        if earlier is not None and later is not None:
            return point_between(earlier, later, stamp_ns)
        end = earlier or later
        assert end is not None
        return end

    def driven_at(self, stamp_ns: int) -> tuple[float, float]:
        """Path length [m] and sum of absolute turns [rad] up to an instant, as in :meth:`standing_at`."""
        earlier, later = self.around(stamp_ns)
        if earlier is not None and later is not None:
            return driven_between(earlier, later, stamp_ns)
        end = earlier or later
        assert end is not None
        return end.travelled_m, end.turned_rad

    def path_to(self, point: OdometryPoint) -> OdometryPath:
        """The path through the kept points before ``point``, and to it."""
        return OdometryPath.of([*(each for stamp_ns, each in self if stamp_ns < point.stamp_ns), point])
