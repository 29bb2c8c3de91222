"""An open world in flat space is that of the plane: histories, rates, existence and places, with a detector's labels.

Two things differ by construction. First detections and false alarms are even over a volume V, not over an area A: per
metre and radians of the ray, their density at range r is r^2 / V, in the plane r / A. And each detection has an
elevation, whose density is the same whatever object on the floor it is of. Where an object has no map, its height
follows from its detections: that they agree in it is evidence for it.
"""

import numpy as np
import pytest
from worlds.scenes.flat_space import LABELS, START, STEP, STEP_VARIANCES, FlatWorld, driven, seen_from

from semantic_slam import Engine
from semantic_slam.geometry import se2
from semantic_slam.inference.open_world.planar.detection_probability import polar_variances
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.spatial.region import SpatialRegion

OBJECTS = np.array([[1.5, -2.0], [1.9, -1.7], [2.5, -2.4], [2.2, -1.2], [3.0, -2.0]])
SEEN = [(0, 2), (1, 4), (0, 3)]
EVERY_HISTORY = {
    "weights": {"gate": 14.0, "max_associations": 0},
    "pruning": {"ratio": 1e7, "max_hypotheses": 10**6},
}


def log_weights(engine: Engine) -> dict[tuple, float]:
    """Of each association history."""
    found: dict[tuple, float] = {}
    for live in engine.live.values():
        beta = tuple(step.association for step in live.lineage)
        found[beta] = float(np.logaddexp(found.get(beta, -np.inf), live.log_weight))
    return found


def _log_new(world: FlatWorld, range_m: float) -> float:
    """Log density of a first detection or a false alarm in space, relative to that in the plane."""
    return float(np.log(world.area_m2 * range_m / world.volume_m3))


def _log_height(variance: float) -> float:
    """Log density of an elevation that is as expected."""
    return -0.5 * float(np.log(2.0 * np.pi * variance))


@pytest.mark.long
def test_histories_among_mapped_objects_weigh_what_they_do_in_the_plane() -> None:
    """To 1e-6, with first detections and false alarms denser by A r / V, and others by that of an elevation.

    Only histories in which nothing new is seen twice: all heights are known.
    """
    errors = np.random.default_rng(0).normal(size=(3, 2, 2)) * [0.05, 0.1]
    frames = seen_from(driven(3), OBJECTS, SEEN, errors)
    apart = {"merge_position_m": 0.0, "gate_sigma": 6.0}
    world = FlatWorld(frames=frames, bearing_sigma=0.1, objects=OBJECTS, world=apart, values=EVERY_HISTORY)
    (plane, flat), (space, level) = world.planar(), world.spatial()
    expected, found = log_weights(plane), log_weights(space)

    def factor(beta: tuple) -> float:
        seen = [(n, r) for own, frame in zip(beta, frames, strict=True) for n, (r, *_) in zip(own, frame, strict=True)]
        return sum(_log_height(0.1**2) if n < len(OBJECTS) else _log_new(world, r) for n, r in seen)

    def is_seen_once(beta: tuple) -> bool:
        new = [n for own in beta for n in own if n >= len(OBJECTS)]
        return len(new) == len(set(new))

    common = sorted(beta for beta in expected.keys() & found.keys() if is_seen_once(beta))
    ratios = np.array([found[beta] - expected[beta] - factor(beta) for beta in common])
    assert len(common) >= 10 and np.ptp([expected[beta] for beta in common]) > 5.0
    np.testing.assert_allclose(ratios, ratios[common.index(max(expected, key=expected.__getitem__))], atol=1e-6)
    for own, other in zip(flat, level, strict=True):
        np.testing.assert_array_equal(own.object_ids, other.object_ids)


EXACT = [(0, 2, 3), (0, 1, 2), (1, 2), (), (4, 1), (1, 4, 2), (1,), (2, 4)]


def test_objects_without_a_map_are_as_sure_as_in_the_plane_and_their_heights_besides() -> None:
    """Errors are 0. Existence after one detection, and misses, is the planar one; each more detection adds evidence.

    The odds of existence are those of the plane times the density of its elevation, expected by the heights seen so
    far, over that of the false alarm that it is else.
    """
    frames = seen_from(driven(len(EXACT)), OBJECTS, EXACT, np.zeros((len(EXACT), 3, 2)))
    values = {"weights": {"gate": 6.0}, "pruning": {"max_hypotheses": 1}}
    rates = {"detection_probabilities": [0.8], "clutters_per_frame": [0.2], "birth_densities": [0.3]}
    world = FlatWorld(frames=frames, bearing_sigma=0.02, world=rates, values=values)
    (_, flat), (_, level) = world.planar(), world.spatial()
    heights: dict[int, tuple[float, float]] = {}
    num_again = 0
    for own, other, frame in zip(flat, level, frames, strict=True):
        np.testing.assert_array_equal(own.object_ids, other.object_ids)
        np.testing.assert_allclose(other.poses[0], own.poses[0], atol=1e-6)
        np.testing.assert_allclose(other.object_poses[:, :2], own.object_poses[:, :2], atol=1e-6)
        spreads = (each.object_covariances[:, :2, :2] for each in (own, other))
        np.testing.assert_allclose(*spreads, atol=1e-6)
        for n, (range_m, *_) in zip(own.hypotheses[0].associations, frame, strict=True):
            precision, evidence = heights.get(n, (0.0, 0.0))
            if precision:
                evidence += _log_height(0.02**2 + 1.0 / precision / range_m**2) - _log_new(world, range_m)
            heights[n] = precision + 1.0 / (0.02 * range_m) ** 2, evidence
        gained = np.array([heights[n][1] for n in own.object_ids.tolist()])
        doubted = np.flatnonzero(1.0 - other.existence > 1e-9)  # of others rounding leaves too few digits
        odds = [each.existence[doubted] / (1.0 - each.existence[doubted]) for each in (own, other)]
        np.testing.assert_allclose(odds[1], odds[0] * np.exp(gained[doubted]), rtol=1e-4)
        num_again += int((gained[doubted] > 0.0).sum())
    assert num_again >= 5


FLAT = SensorRegion(min_range_m=0.5, max_range_m=3.0, field_of_view_rad=1.4, occluder_radius_m=0.1)
LEVEL = SpatialRegion(min_range_m=0.5, max_range_m=3.0, half_width_rad=0.7, half_height_rad=0.5, occluder_radius_m=0.1)
RANGES, BEARINGS = np.array([0.9, 1.3, 2.1]), np.array([-0.3, 0.2, 0.25])


def scattered() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places (N, 2) of the plane with (N, 2, 2), then both as points of the optical frame, of exact height."""
    random = np.random.default_rng(5)
    reach, turn = random.uniform(0.4, 3.2, 300), random.uniform(-0.8, 0.8, 300)
    places = reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    roots = 0.07 * random.normal(size=(300, 2, 2))
    spread = roots @ np.swapaxes(roots, 1, 2) + 1e-4 * np.eye(2)
    body, covariance = np.zeros((300, 3)), np.zeros((300, 3, 3))
    body[:, :2], covariance[:, :2, :2] = places, spread
    return places, spread, LEVEL.camera.seen(body), LEVEL.camera.turned(covariance)


def test_an_object_on_the_floor_is_inside_the_region_as_in_the_plane() -> None:
    places, spread, seen, covariance = scattered()
    np.testing.assert_allclose(LEVEL.contains(seen, covariance), FLAT.contains(places, spread), atol=1e-4)


def test_an_object_on_the_floor_is_hidden_as_in_the_plane() -> None:
    """Its direction is uncertain along the floor alone."""
    places, spread, seen, covariance = scattered()
    errors = np.tile([0.03**2, 0.02**2], (3, 1))
    own = polar_variances(places, spread)[:, None] + errors
    expected = FLAT.not_occluded(places, RANGES, BEARINGS, variances=own)
    shown = np.stack([RANGES * np.cos(BEARINGS), RANGES * np.sin(BEARINGS), np.zeros(3)], axis=1)
    found = LEVEL.not_occluded(seen, covariance, LEVEL.camera.seen(shown), errors)
    assert expected.min() < 0.1 and (expected > 0.9).sum() > 50
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_a_drive_with_misses_and_false_alarms_ends_with_the_map_of_the_plane() -> None:
    """Pruned, with occlusion and earlier looks: equal objects exist, at equal places, seen by equal detections."""
    random, path = np.random.default_rng(1), [START]
    things = random.uniform([0.5, -3.5], [4.0, 1.0], (9, 2))
    for _ in range(15):
        path.append(se2.compose(se2.compose(path[-1], STEP), np.sqrt(STEP_VARIANCES) * random.normal(size=3)))
    seen = [tuple(n for n in _in_view(x, things) if random.random() < 0.85) for x in path[1:]]
    frames = seen_from(path[1:], things, seen, random.normal(size=(15, 9, 2)) * [0.03, 0.01])
    for k in (3, 8):
        frames[k].append((1.1, 0.5, LABELS[0]))
    shadows = {"occluder_radius_m": 0.05, "least_undetected_share": 0.005}
    world = FlatWorld(frames=frames, bearing_sigma=0.01, world=shadows, values={"pruning": {"max_hypotheses": 20}})
    (plane, flat), (space, level) = world.planar(), world.spatial()
    there, found = (belief.object_ids[belief.existence > 0.5].tolist() for belief in (flat[-1], level[-1]))
    assert there == found and len(there) >= 5
    best = [max(engine.live.values(), key=lambda live: live.log_weight) for engine in (plane, space)]
    assert [own.association for own in best[0].lineage] == [own.association for own in best[1].lineage]
    for own, other in zip(flat, level, strict=True):
        np.testing.assert_allclose(other.poses[0], own.poses[0], atol=1e-5)
    places = (each.object_poses[each.existence > 0.5, :2] for each in (flat[-1], level[-1]))
    np.testing.assert_allclose(*places, atol=1e-5)


def _in_view(pose: np.ndarray, things: np.ndarray) -> list[int]:
    body = np.array([se2.between(pose, np.append(place, 0.0))[:2] for place in things])
    reach, turn = np.hypot(*body.T), np.arctan2(body[:, 1], body[:, 0])
    return np.flatnonzero((reach > 0.4) & (reach < 3.8) & (np.abs(turn) < 0.66)).tolist()
