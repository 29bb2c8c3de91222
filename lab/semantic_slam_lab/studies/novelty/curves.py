"""Share of pictures that are called unknown, against the share of known objects' views that are."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.training.appearance import LEFT_OUT, fit_appearance
from semantic_slam.viewpoint.appearance import KnownAppearance, hellinger
from semantic_slam_lab.studies.novelty.features import Measured, Views

RATES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
"""False alarms."""
STATED = 0.05
"""The false alarms that claims are about."""
KNOWN, UNKNOWN = "known", "unknown"
OURS, NEAREST = "ours", "nearest"
METHODS = {
    OURS: "ours: densities of known and of made-up things",
    NEAREST: "cosine to the nearest fitted view",
}


@dataclass(frozen=True)
class Scores:
    """Novelty of pictures by one method in one draw, higher for those that look unlike known objects."""

    limits: Array  # (Q,) of views left out of the fit, from which limits are taken
    groups: Mapping[str, Array]  # (N,) of known and unknown objects' new views, and of pictures without an object


def scores_of(measured: Measured, known: Index) -> dict[str, Scores]:
    """Scores by method, where the objects ``known`` are known and all others are not."""
    fitted = _only(measured.fitted, np.isin(measured.fitted.instance, known))
    is_known = np.isin(measured.tested.instance, known)
    groups = {KNOWN: measured.tested.features[is_known], UNKNOWN: measured.tested.features[~is_known]}
    groups |= measured.others
    appearance = fit_appearance(fitted.features, fitted.instance, fitted.direction, measured.made_up, measured.probe)
    assert appearance is not None  # directions all around
    return {OURS: _by_densities(appearance, groups), NEAREST: _by_cosine(fitted, groups)}


def _only(views: Views, wanted: Flags) -> Views:
    rows = np.flatnonzero(wanted)
    return replace(views, features=views.features[rows], instance=views.instance[rows], direction=views.direction[rows])


def _by_densities(appearance: KnownAppearance, groups: Mapping[str, Array]) -> Scores:
    return Scores(appearance.known_scores, {name: appearance.novelty(features) for name, features in groups.items()})


def _by_cosine(fitted: Views, groups: Mapping[str, Array]) -> Scores:
    """One direction in LEFT_OUT sets the limit and is not among the neighbours, as in the fit of ours."""
    left_out = fitted.direction % LEFT_OUT == 0
    stored = hellinger(fitted.features[~left_out])

    def away(features: Array) -> Array:
        return np.asarray(1.0 - (hellinger(features) @ stored.T).max(axis=1))

    return Scores(np.sort(away(fitted.features[left_out])), {name: away(features) for name, features in groups.items()})


def curve_of(draws: list[Scores]) -> dict[str, dict[str, list[float]]]:
    """By group the share that is called unknown, at every rate of :data:`RATES`; means over draws.

    ``stated``: the limit is that of the views left out of the fit, so that of known objects' new views about the rate
    is called unknown. ``realised``: the limit is the rate's quantile of these new views themselves, as methods are
    compared.
    """
    limits = {
        "stated": [[np.quantile(own.limits, 1.0 - rate, method="higher") for rate in RATES] for own in draws],
        "realised": [[np.quantile(own.groups[KNOWN], 1.0 - rate) for rate in RATES] for own in draws],
    }
    return {
        kind: {name: _shares([own.groups[name] for own in draws], found) for name in draws[0].groups}
        for kind, found in limits.items()
    }


def _shares(scores: list[Array], limits: list[list[Any]]) -> list[float]:
    """(rates,) mean over draws of the share of scores above the limit."""
    above = [(own[:, None] > np.array(limit)).mean(axis=0) for own, limit in zip(scores, limits, strict=True)]
    return [float(share) for share in np.mean(above, axis=0)]


def separation(draws: list[Scores]) -> dict[str, float]:
    """By group the probability that a picture of it scores above a known object's view (area under the curve)."""
    names = [name for name in draws[0].groups if name != KNOWN]
    return {name: float(np.mean([_area(own.groups[KNOWN], own.groups[name]) for own in draws])) for name in names}


def _area(known: Array, others: Array) -> float:
    ordered = np.sort(known)
    below, up_to = (np.searchsorted(ordered, others, side=side) for side in ("left", "right"))
    return float((below + up_to).mean() / (2 * len(known)))
