"""Map of a recorded run, by re-running its inference: beliefs lack the correlations between objects."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from semantic_slam.configuration import from_dict
from semantic_slam.configuration.configuration import SPATIAL
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import Record, json_object
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.object_coordinates import object_coordinates
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.open_world.planar.region import region_of
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.reported.component_marginals import existence_of, held_as, mover_marginals
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.world.carried import new_grounds
from semantic_slam.inference.world.objects import ReportedObjects
from semantic_slam.maps.checks import MOST_OBJECTS
from semantic_slam.maps.class_priors import class_priors_of
from semantic_slam.maps.from_belief import MOVES, mapped_rows, saved_map_of_belief
from semantic_slam.maps.saved_map import MapHypotheses, SavedMap, ViewedFrom
from semantic_slam.pipeline.recorded_keyframes import recorded_keyframes

KEPT_MASS, MOST_HYPOTHESES, MOST_NUMBERS = 0.999, 50, 1 << 23
"""Limits of the heaviest hypotheses kept: total mass, their number, and the number of covariance entries."""


def saved_map_of_bag(bag: Path, *, marginals_alone: bool = False) -> SavedMap:
    """Map at the end of the run in a belief bag. Raises InputError.

    ``marginals_alone``: use the last belief, without re-running the inference.
    """
    record = read_record(bag)
    if marginals_alone:
        return saved_map_of_belief(record.beliefs[-1], record.run)
    configuration = from_dict(json_object(record.run.configuration), str(bag))
    return saved_map_of_run(record, recorded_keyframes(bag, configuration, len(record.beliefs)))


def saved_map_of_run(record: Record, keyframes: Iterable[Keyframe]) -> SavedMap:
    """Map at the end of a re-run inference. Raises InputError where the result differs from the recording."""
    pool = InProcessPool(1)
    engine, again = Engine.of_run(record.run, pool), None
    for keyframe in keyframes:
        again = engine.process(keyframe)
    last = record.beliefs[-1]
    if again is None or not np.array_equal(again.hypothesis_ids, last.hypothesis_ids):
        if late := record.begun_late:
            raise InputError(f"{late}; save with --marginals")
        raise InputError(
            f"keyframe {last.keyframe}: inferred again, the hypotheses are not those recorded; save with the version"
            f" that recorded the bag (revision {record.run.revision or 'not recorded'}), or with --marginals"
        )
    return saved_map_of_engine(engine, pool, last)


def saved_map_of_engine(engine: Engine, pool: InProcessPool, belief: HybridBelief) -> SavedMap:
    """Map of an engine with in-process backends, at its newest belief. Raises InputError."""
    rows = mapped_rows(belief, engine.run)
    if len(rows) > MOST_OBJECTS:
        raise InputError(
            f"{len(rows)} objects were mapped, a map file has {MOST_OBJECTS} at most; use the objects.json"
        )
    known, chosen = saved_map_of_belief(belief, engine.run), _chosen(engine, belief, len(rows))
    reported = engine.association.reported(engine.registry, set(belief.object_ids.tolist()))
    parts, components = [], []
    for number in belief.hypothesis_ids[chosen].tolist():
        try:
            components.append(pool.component(number))
            parts.append(_hypothesis(components[-1], known.objects.ids, reported))
        except LostComponentError as fault:
            raise InputError(f"hypothesis {number}: {fault}; save the map with --marginals") from None
    weights = np.exp(belief.log_weights[chosen])
    existence, states, covariances = (np.array(column) for column in zip(*parts, strict=True))
    hypotheses = MapHypotheses(
        log_weights=np.log(weights / weights.sum()),
        existence=existence,
        class_probabilities=belief.hypothesis_class_probabilities[np.ix_(chosen, rows)],
        states=states,
        covariances=covariances,
    )
    ids = known.objects.ids
    objects = replace(
        known.objects,
        sightings=_sightings(engine, int(belief.hypothesis_ids[chosen[0]]), ids),
        class_priors=class_priors_of(components, weights, ids, reported, engine.problem.class_shares),
    )
    looks = _looks(engine, belief, components[0])
    left_out = 1.0 - (1.0 - known.discarded_mass) * min(float(weights.sum()), 1.0)
    return replace(
        known,
        objects=objects,
        hypotheses=hypotheses,
        has_cross_covariances=True,
        looks=looks,
        discarded_mass=left_out,
    )


def _chosen(engine: Engine, belief: HybridBelief, num_objects: int) -> Index:
    """Rows of the hypotheses to keep, heaviest first; those that do not localise the robot are left out.

    Raises InputError where none localises it.
    """
    lineages = [engine.live[number].lineage for number in belief.hypothesis_ids.tolist()]
    order = [
        row
        for row in np.argsort(-belief.log_weights, kind="stable").tolist()
        if engine.problem.is_placed(lineages[row]) and not new_grounds(lineages[row])
    ]
    if not order:
        raise InputError("the robot did not find out where on its map it is, so nothing new is on it; use the old map")
    weights = np.exp(belief.log_weights[order])
    enough = 1 + int(np.searchsorted(np.cumsum(weights), KEPT_MASS * weights.sum()))
    most = max(MOST_NUMBERS // max(3 * num_objects, 1) ** 2, 1)
    return np.array(order[: min(enough, most, MOST_HYPOTHESES)], dtype=int)


def _sightings(engine: Engine, number: int, ids: Index) -> Array:
    """(O,) number of detections of each object in a hypothesis."""
    on_map = engine.problem.displaced.on_map
    seen = Counter(on_map.get(own, own) for step in engine.live[number].lineage for own in step.association)
    return np.array([float(seen[own]) for own in ids.tolist()])


def _looks(engine: Engine, belief: HybridBelief, component: Component) -> ViewedFrom:
    """Poses from which a component has looked, and the region as learned in the end; empty in space.

    Empty, too, where the region was to be learned and nothing has been detected.
    """
    if component.spaces.name == SPATIAL:
        return ViewedFrom()
    own = region_of(engine.problem.open_world, belief.noise)
    if not own.is_known:
        return ViewedFrom()
    bounds = np.array([own.direction_rad, own.field_of_view_rad, own.min_range_m, own.max_range_m])
    return ViewedFrom(path=component.path()[:, :3], region=bounds)


def _hypothesis(component: Component, ids: Index, reported: ReportedObjects) -> tuple[Array, Array, Array]:
    """(O,) existence, (O, 3) coordinates and (3 O, 3 O) covariances, in the map frame, of a component's objects."""
    count = len(ids)
    existence, states = np.zeros(count), np.full((count, 3), np.nan)
    covariances = np.full((3 * count, 3 * count), np.nan)
    rows = [row for row, number in enumerate(ids.tolist()) if number in component.object_ids]
    held = [held_as(component, int(ids[row]), reported) for row in rows]
    for row, number in zip(rows, held, strict=True):
        other = reported.displaced.partner.get(number)
        existence[row] = existence_of(component, number) + (0.0 if other is None else existence_of(component, other))
    blocks = []
    if rows:
        states[rows], square = _in_map(component, *component.joint_of_objects(held))
        blocks.append(square)
    if (apart := _standing_apart(component, ids)) is not None:
        own = np.flatnonzero(np.isin(ids, apart.ids)).tolist()
        _, robot = component.robot_and_objects([])
        existence[own], states[own], alone = mover_marginals(component, apart, robot[0])
        rows, blocks = rows + own, [*blocks, *alone]
    places = (3 * np.array(rows, dtype=int)[:, None] + np.arange(3)).ravel()
    covariances[np.ix_(places, places)] = block_diag(*blocks) if blocks else np.zeros((0, 0))
    return np.minimum(existence, 1.0), states, covariances


def _standing_apart(component: Component, ids: Index) -> Movers | None:
    """Static objects among a component's possibly moving ones; None: there are none.

    Their correlation with the other objects, through the robot pose, is left out.
    """
    movers = component.movers
    if movers is None:
        return None
    stand = movers.decided & (movers.drives <= MOVES) & np.isin(movers.ids, ids)
    return movers.take(stand) if stand.any() else None


def _in_map(component: Component, states: Array, joint: Array) -> tuple[Array, Array]:
    """(n, 3) coordinates and (3 n, 3 n) covariance in the map frame, from states and tangent-space covariance."""
    space, count = component.spaces.landmark, len(states)
    size = space.tangent_size
    blocks = space.position_slopes(states)  # (n, p, l)
    slopes = np.zeros((count, 3, size))
    slopes[:, : blocks.shape[1]] = blocks
    if space.heading is not None:
        slopes[:, 2, space.heading] = 1.0
    pairs = joint.reshape(count, size, count, size)
    turned = np.einsum("iab,ibjc,jdc->iajd", slopes, pairs, slopes).reshape(3 * count, 3 * count)
    coordinates = object_coordinates(component.spaces.name)
    return coordinates.of_poses(space.poses(states)), 0.5 * (turned + turned.T)
