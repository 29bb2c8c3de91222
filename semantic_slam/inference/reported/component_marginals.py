"""Marginals of robot and objects in the hypotheses of a backend, aligned to the reported objects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.open_world.existence import LEAST_PROBABILITY
from semantic_slam.inference.open_world.moving.moving_objects import as_objects
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.objects import ReportedObjects


@dataclass(frozen=True, kw_only=True)
class ComponentMarginals:
    """Marginals of robot and n objects in one hypothesis; rows are as wide as the wider kind of state."""

    present: Index  # (n,) rows of its objects among those reported
    states: Array  # (1 + n, s) the robot first
    covariances: Array  # (1 + n, w, w)
    existence: Array  # (n,)


def component_marginals(component: Component, reported: ReportedObjects) -> ComponentMarginals:
    """Marginals of a component: its static objects and the movers that it has decided on. Raises LostComponentError.

    A mapped object is represented by itself or by its displaced twin, whichever exists more likely.
    """
    known_ids = component.object_ids
    present = [row for row, n in enumerate(reported.ids) if n in known_ids]
    ids = [held_as(component, reported.ids[row], reported) for row in present]
    states, covariances = component.robot_and_objects(ids)
    existence = component.objects.existence[component.objects.rows(np.array(ids, dtype=int))]
    for at, number in enumerate(ids):
        if (other := reported.displaced.partner.get(number)) is not None:
            existence[at] += existence_of(component, other)
    known = ComponentMarginals(
        present=np.array(present, dtype=int), states=states, covariances=covariances, existence=existence
    )
    return known if component.movers is None else _with_movers(known, component, component.movers, reported)


def held_as(component: Component, number: int, reported: ReportedObjects) -> int:
    """Id under which a component holds a mapped object: its own or that of its displaced twin, the likelier one."""
    other = reported.displaced.elsewhere.get(number)
    if other is None:
        return number
    return other if existence_of(component, other) > existence_of(component, number) else number


def existence_of(component: Component, number: int) -> float:
    """Probability of existence of an object in a component."""
    return float(component.objects.existence[component.objects.rows(np.array(number))])


def _with_movers(
    known: ComponentMarginals, component: Component, movers: Movers, reported: ReportedObjects
) -> ComponentMarginals:
    """Add the objects that the hypothesis has decided to be movers."""
    own = movers.take(movers.decided)
    if not len(own):
        return known
    existence, states, covariances = mover_marginals(component, own, known.covariances[0])
    return ComponentMarginals(
        present=np.concatenate([known.present, [reported.row_of[n] for n in own.ids.tolist()]]),
        states=np.concatenate([known.states, states]),
        covariances=np.concatenate([known.covariances, covariances]),
        existence=np.concatenate([known.existence, existence]),
    )


def mover_marginals(component: Component, movers: Movers, robot_covariance: Array) -> tuple[Array, Array, Array]:
    """(T,) existence, (T, 3) states and (T, 3, 3) covariances of the given movers of a component.

    ``robot_covariance`` (3, 3) is that of the newest pose, in its tangent space.
    """
    observer = component.observer(robot_covariance)
    states, covariances = as_objects(movers.seen_from(observer), observer.covariances[0])
    return component.objects.rates.average(movers.existence), states, covariances


def motion_marginals(components: Sequence[Component], reported: ReportedObjects) -> dict[str, Array]:
    """(H, O) probabilities ``moving`` and (H, O, 6) ``object_velocities`` by hypothesis, NaN for absent objects.

    Both are given that the object exists. {} if no object may move. What is not a decided mover has velocity 0.
    """
    if not components or components[0].movers is None:
        return {}
    moving = np.full((len(components), len(reported.ids)), np.nan)
    velocities = np.full((*moving.shape, 6), np.nan)
    for row, component in enumerate(components):
        standing = [reported.row_of[n] for n in component.object_ids]
        moving[row, standing], velocities[row, standing] = 0.0, 0.0
        movers = component.movers
        assert movers is not None
        at = np.array([reported.row_of[n] for n in movers.ids.tolist()], dtype=int)
        moving[row, at] = _moving(movers, component.objects.rates)
        means = np.einsum("ts,tsi->ti", np.exp(movers.log_speeds), movers.means)
        velocities[row, at[movers.decided]] = 0.0
        velocities[row, at[movers.decided], :2] = means[movers.decided, 2:4]
    return {"moving": moving, "object_velocities": velocities}


def existence_marginals(components: Sequence[Component], reported: ReportedObjects) -> dict[str, Array]:
    """(H, O) by hypothesis, NaN for absent objects: ``missing`` if objects leave, ``track_scores`` if misses count."""
    told = {
        "missing": [own.objects.missing for own in components],
        "track_scores": [own.objects.track_score for own in components],
    }
    rows = [[reported.row_of[n] for n in own.objects.ids.tolist()] for own in components]
    found: dict[str, Array] = {}
    for name, values in told.items():
        if values and values[0] is not None:
            found[name] = np.full((len(components), len(reported.ids)), np.nan)
            for row, (places, own) in enumerate(zip(rows, values, strict=True)):
                found[name][row, places] = own
    return found


def _moving(movers: Movers, rates: DetectionRates) -> Array:
    """(T,) probability that an object in the table of movers moves, if it exists."""
    exists = np.maximum(rates.average(movers.existence), LEAST_PROBABILITY)
    may_move = np.where(movers.decided, 1.0, rates.average(movers.existence * movers.moving) / exists)
    return np.asarray(may_move * movers.drives)


def aligned_marginals(
    parts: Sequence[ComponentMarginals], num_objects: int, spaces: Spaces
) -> tuple[Array, Array, Array]:
    """(H, 1 + O, s) states, (H, 1 + O, w, w) covariances and (H, O) existence, NaN for absent objects."""
    shape, width = (len(parts), 1 + num_objects), spaces.layout.width
    states = np.full((*shape, spaces.storage.width), np.nan)
    covariances = np.full((*shape, width, width), np.nan)
    existence = np.full((len(parts), num_objects), np.nan)
    for row, part in enumerate(parts):
        at = np.append(0, 1 + part.present)
        states[row, at], covariances[row, at] = part.states, part.covariances
        existence[row, part.present] = part.existence
    return states, covariances, existence
