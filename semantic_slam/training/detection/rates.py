"""How often a detector detects what is in view, by distance, direction and in runs, told by the looks of runs.

    pD(r, b) = p 2^-(r / h)^2 s(b),

with the shares s of directions in the field of view (:mod:`directions`), and misses that come in runs, as an open world
has them (``DetectionRates``): the same forward algorithm over every object's looks, under each of the settings of a
grid. Stretches of the drives that are held out judge it against what the runs were configured with, and directions
against all of them alike.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.training.detection.directions import Directions
from semantic_slam.training.detection.evidence import RunLooks
from semantic_slam.training.detection.looks import Looks
from semantic_slam.viewpoint.detection_values import UNTOLD, DetectionValues

PROBABILITIES = (0.3, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 0.98)
HALF_RANGES_M = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, np.inf)
PERSISTENCES = (0.0, 0.5, 0.7, 0.85, 0.95)
LEAST_GAIN = 3.0
"""Nats by which held-out log evidence has to be better than as configured, and with directions than without."""


@dataclass(frozen=True, kw_only=True)
class LearnedRates:
    """The likeliest settings, and what held-out stretches say."""

    values: DetectionValues  # of all runs
    without: tuple[DetectionValues, ...]  # (B,) of the other runs
    num_looks: int
    before: float  # nats, as configured
    alike: float  # nats, with all directions alike
    by_direction: float | None  # nats; None: not compared, as the fields of view of the runs differ

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
            "log_evidence": {"before": self.before, "after": self.alike, "by_direction": self.by_direction},
            **asdict(self.values),
        }


def grid() -> DetectionRates:
    """The settings that are tried."""
    return _rates(list(product(PROBABILITIES, HALF_RANGES_M, PERSISTENCES)))


def configured(settings: OpenWorldConfiguration) -> DetectionRates:
    """What a run is told of its detector."""
    return DetectionRates.of(settings).sensors[0]


def learned(runs: Sequence[Looks | None], settings: OpenWorldConfiguration, num_stretches: int) -> LearnedRates:
    """From the looks of B runs, which ``settings`` were given to."""
    looks, tried = RunLooks(runs=runs, num_stretches=num_stretches), grid()
    told = Directions(looks=looks, tried=tried, alike=looks.log_evidence(tried))
    before = _held_out(looks.log_evidence(configured(settings)).sum(axis=0))
    alike = _held_out(told.alike.sum(axis=0))
    by_direction = _held_out_by_direction(told) if looks.of_one_view else None
    best = alike if by_direction is None or by_direction < alike + LEAST_GAIN else by_direction
    has_directions = best > alike
    values, without = UNTOLD, (UNTOLD,) * len(runs)
    if best >= before + LEAST_GAIN:
        width = looks.field_of_view_rad if has_directions else None
        every = np.ones((len(runs), num_stretches), dtype=bool)
        values = _likeliest(told, every, width)
        if len(runs) > 1:
            without = tuple(_likeliest(told, every & ~own[:, None], width) for own in np.eye(len(runs), dtype=bool))
    return LearnedRates(
        values=values,
        without=without,
        num_looks=looks.num_in_view,
        before=before,
        alike=alike,
        by_direction=by_direction,
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


def _held_out(by_stretch: Array) -> float:
    """Log evidence of (F, G) stretches, each under what the others tell of the settings, all alike before."""
    others = by_stretch.sum(axis=0) - by_stretch
    return float((log_sum_exp(others + by_stretch, axis=1) - log_sum_exp(others, axis=1)).sum())


def _held_out_by_direction(told: Directions) -> float:
    """Log evidence of stretches, each under what the others tell of the settings, and of the shares of directions."""
    total, shape = 0.0, told.alike.shape[:2]
    for fold in np.eye(shape[1], dtype=bool):
        counted = np.broadcast_to(~fold, shape)
        by_stretch = told.log_evidence(told.likeliest(counted)).sum(axis=0)
        others = by_stretch[~fold].sum(axis=0)
        total += float(log_sum_exp(others + by_stretch[fold][0], axis=0) - log_sum_exp(others, axis=0))
    return total


def _likeliest(told: Directions, counted: Flags, field_of_view_rad: float | None) -> DetectionValues:
    """The likeliest of the settings by stretches (B, F); None: with all directions alike."""
    rates, evidence, shares = told.tried, told.alike, tuple[float, ...]()
    if field_of_view_rad is not None:
        found = told.likeliest(counted)
        evidence, shares = told.log_evidence(found), tuple(found.tolist())
    best = int(np.argmax(evidence[counted].sum(axis=0)))
    half_range = float(rates.half_range_m[best])
    return DetectionValues(
        probability=float(rates.probability[best]),
        half_range_m=half_range if np.isfinite(half_range) else None,
        persistence=float(rates.persistence[best]),
        by_direction=shares,
        field_of_view_rad=field_of_view_rad,
    )
