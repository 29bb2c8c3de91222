"""How often a detector detects what is in view, by distance and in runs, told by the looks of runs.

    pD(r) = p 2^-(r / h)^2,

and misses that come in runs, as an open world has them (``DetectionRates``): the same forward algorithm over every
object's looks, under each of the settings of a grid. Stretches of the drives that are held out judge it against what
the runs were configured with.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.training.detection.looks import Looks
from semantic_slam.viewpoint.detection_values import UNTOLD, DetectionValues

PROBABILITIES = (0.3, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 0.98)
HALF_RANGES_M = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, np.inf)
PERSISTENCES = (0.0, 0.5, 0.7, 0.85, 0.95)
LEAST_GAIN = 3.0
"""Nats by which held-out log evidence has to be better than as configured."""
LEAST_PROBABILITY = 1e-12


@dataclass(frozen=True, kw_only=True)
class LearnedRates:
    """The likeliest settings, and what held-out stretches say."""

    values: DetectionValues  # of all runs
    without: tuple[DetectionValues, ...]  # (B,) of the other runs
    num_looks: int
    before: float  # nats, as configured
    after: float  # nats

    @property
    def is_kept(self) -> bool:
        """Whether there was enough to learn from."""
        return self.values.probability is not None

    @property
    def numbers(self) -> dict[str, Any]:
        """By name, for reports."""
        return {
            "is_kept": self.is_kept,
            "looks": self.num_looks,
            "log_evidence": {"before": self.before, "after": self.after},
            **asdict(self.values),
        }


def grid() -> DetectionRates:
    """The settings that are tried."""
    return _rates(list(product(PROBABILITIES, HALF_RANGES_M, PERSISTENCES)))


def configured(settings: OpenWorldConfiguration) -> DetectionRates:
    """What a run is told of its detector."""
    return DetectionRates.of(settings).sensors[0]


def learned(runs: Sequence[Sequence[Looks]], settings: OpenWorldConfiguration, num_stretches: int) -> LearnedRates:
    """From the looks of B runs, which ``settings`` were given to."""
    tried, before = grid(), configured(settings)
    new = np.array([_by_stretch(own, tried, num_stretches) for own in runs])  # (B, F, G)
    old = np.array([_by_stretch(own, before, num_stretches) for own in runs])
    num_looks = sum(own[0].num_in_view for own in runs if own)
    held_out = _held_out(old.sum(axis=0)), _held_out(new.sum(axis=0))
    is_better = held_out[1] >= held_out[0] + LEAST_GAIN
    every = new.sum(axis=(0, 1))
    return LearnedRates(
        values=_likeliest(tried, every) if is_better else UNTOLD,
        without=tuple(
            _likeliest(tried, every - own.sum(axis=0)) if is_better and len(runs) > 1 else UNTOLD for own in new
        ),
        num_looks=num_looks,
        before=held_out[0],
        after=held_out[1],
    )


def _rates(values: Sequence[tuple[float, ...]]) -> DetectionRates:
    probability, half_range, persistence = np.array(values, dtype=np.float64).T
    return DetectionRates(
        probability=probability,
        half_range_m=half_range,
        persistence=persistence,
        birth_density=np.zeros(len(values)),
        clutter_per_frame=np.zeros(len(values)),
        log_weights=np.full(len(values), -np.log(len(values))),
    )


def _by_stretch(hypotheses: Sequence[Looks], rates: DetectionRates, count: int) -> Array:
    """(F, G) log evidence of the looks of a run, the mean of its hypotheses', by stretches of as many keyframes."""
    found = np.zeros((count, len(rates)))
    total = sum(own.weight for own in hypotheses)
    for own in hypotheses:
        logs = log_evidence(own, rates)
        for number, rows in enumerate(np.array_split(np.arange(len(logs)), count)):
            found[number] += own.weight / total * logs[rows].sum(axis=0)
    return found


def log_evidence(looks: Looks, rates: DetectionRates) -> Array:
    """(K, G) of what was detected and missed in each keyframe, given those before."""
    found = np.zeros((len(looks.in_view), len(rates)))
    detectable = np.ones((looks.in_view.shape[1], len(rates)))
    for keyframe, known in enumerate(looks.is_known):
        rows = np.flatnonzero(known)
        seen = looks.is_detected[keyframe, rows]
        chance = looks.in_view[keyframe, rows, None] * rates.runs.hit * rates.fall_off(looks.ranges_m[keyframe, rows])
        detected = chance * rates.runs.next(detectable[rows])
        logs = np.log(np.maximum(np.where(seen[:, None], detected, 1.0 - detected), LEAST_PROBABILITY))
        found[keyframe] = looks.existence[rows] @ logs
        detectable[rows] = rates.runs.after(rates.runs.next(detectable[rows]), detected, seen)
    return found


def _held_out(by_stretch: Array) -> float:
    """Log evidence of (F, G) stretches, each under what the others tell of the settings, all alike before."""
    others = by_stretch.sum(axis=0) - by_stretch
    return float((log_sum_exp(others + by_stretch, axis=1) - log_sum_exp(others, axis=1)).sum())


def _likeliest(rates: DetectionRates, logs: Array) -> DetectionValues:
    """The likeliest of the settings, by (G,) log evidence."""
    best = int(np.argmax(logs))
    half_range = float(rates.half_range_m[best])
    return DetectionValues(
        probability=float(rates.probability[best]),
        half_range_m=half_range if np.isfinite(half_range) else None,
        persistence=float(rates.persistence[best]),
    )
