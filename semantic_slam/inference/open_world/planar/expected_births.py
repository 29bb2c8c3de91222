"""Expected first detections (births) of a hypothesis, in total and at the detections of a keyframe."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.existence import birth
from semantic_slam.inference.open_world.planar.detection_probability import Occluders
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.planar.unseen_ground import first_detections
from semantic_slam.inference.smoothing.component import Component, tracked_states

LEAST_IN_SIGHT = 0.02
"""Least share of first detections that remains behind an occluder, which may be a false alarm itself."""
HIDES = 0.5
"""Existence above which an object counts as an occluder."""


def expected_births(
    settings: OpenWorldConfiguration,
    component: Component,
    region: SensorRegion,
    robot: Array,
    births: list[Birth],
    detections: Sequence[Any],
    second: Array,
) -> tuple[Array, Array, Array]:
    """(G,) first detections expected from ``robot`` (3,), most of them where it has not looked before.

    Also (D, G) log intensities at the detections, and the existence of the objects they would start. Behind another
    detection of the frame hardly anything but false alarms is expected; ``second`` (D, G) [1/m^2] are the intensities
    of duplicate boxes of known objects.
    """
    rates, trail = component.objects.rates, tracked_states(component).trail
    points, weights = _born_at(settings, component, births)
    least, hiding = settings.least_undetected_share, _hiding(component)
    expected, at_points = first_detections(region, rates, trail, robot, points, least, hiding)
    found = (at_points.reshape(*weights.shape, len(rates)) * weights[..., None]).sum(axis=1)
    found *= _in_sight(region, detections)[:, None]
    intensity, existence = birth(found, rates.clutter_per_frame / region.area_m2 + second)
    ranged = np.array([detection.has_range for detection in detections], dtype=bool)
    return expected, np.log(np.where(ranged[:, None], intensity, intensity * region.area_m2)), existence


def _born_at(settings: OpenWorldConfiguration, component: Component, births: list[Birth]) -> tuple[Array, Array]:
    """(D S, 2) sample points in map of where the objects of detections may be, and their (D, S) weights.

    A learned region ends where detections end, errors included: there the positions count as exact.
    """
    known = settings.learn_region or settings.least_undetected_share >= 1.0
    if known or not len(tracked_states(component).trail) or not births:
        return np.array([born.prior.mean[:2] for born in births]).reshape(-1, 2), np.ones((len(births), 1))
    places = [_places(born) for born in births]
    return np.concatenate([points for points, _ in places]), np.array([weights for _, weights in places])


def _in_sight(region: SensorRegion, detections: Sequence[Any]) -> Array:
    """(D,) probability that no other detection occludes a detection, or at least a small share."""
    shown = Occluders.of(detections)
    bearings = shown.bearings_rad
    relative = np.nan_to_num(shown.ranges_m)[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    apart = shown.variances[:, None] + shown.variances
    itself = np.arange(len(bearings))
    seen = region.not_occluded(relative, shown.ranges_m, bearings, variances=apart, detected_as=itself)
    return np.maximum(seen, LEAST_IN_SIGHT)


def _hiding(component: Component) -> Array:
    """(N, 2) positions of likely existing objects, which occlude what is behind them."""
    hides = component.objects.existence > HIDES
    if component.left_behind:
        hides &= ~np.isin(component.objects.ids, list(component.left_behind))
    places: Array = tracked_states(component).states[hides, :2]
    return places


def _places(born: Birth) -> tuple[Array, Array]:
    """(S, 2) sample points in map and their (S,) weights for a detection's object position, given the robot."""
    cos, sin = np.cos(born.prior.mean[2]), np.sin(born.prior.mean[2])
    root = np.array([[cos, -sin], [sin, cos]]) @ np.linalg.cholesky(born.noise[:2, :2])
    offsets = np.sqrt(3.0) * np.concatenate([np.zeros((1, 2)), root.T, -root.T])
    return born.prior.mean[:2] + offsets, np.array([1.0 / 3.0, *(1.0 / 6.0,) * 4])
