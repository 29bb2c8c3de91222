"""From what a keyframe adds to a component to what it adds to the component's smoother (Eqs. 4.9-4.11)."""

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.correlated_errors import ErrorTransition
from semantic_slam.inference.models.odometry_bias import bias_change
from semantic_slam.inference.smoothing.batch_update import Extension
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.keyframe_factors import KeyframeFactors
from semantic_slam.inference.smoothing.semantic_factors import SemanticFactor
from semantic_slam.inference.states.keys import (
    begins_stretch,
    descriptor_key,
    error_keys,
    object_key,
    robot_key,
    vector_parts,
)
from semantic_slam.inference.states.object_views import ObjectViews

JUMP = 0.5
"""Change of the robot's predicted state, metres or radians, from which on the whole graph is optimised at once."""
RANGE_SHARE = 0.1
"""Share of an object's range by which it may be off where it is linearised, if rays alone tell where it is."""
TURN_RAD = 0.3
"""Change of an object's heading from which on it is, too."""


def extension(component: Component, shared: KeyframeFactors, update: ComponentUpdate, *, moved: bool) -> Extension:
    """Factors, variables and semantic measurements of one continuation.

    ``moved``: its robot's mode is elsewhere than odometry has it.
    """
    graph, values = new_factors(component, shared, update)
    classed, jumped = classed_measurements(component, update), _jumped(component, update, moved)
    start = linearisation_start(component, update)
    if component.smoother.semantics.latent is None:
        bounds = _bounds(component, update)
        return Extension(graph=graph, values=values, measurements=classed, start=start, jumped=jumped, bounds=bounds)
    entering = descriptor_measurements(update.views)
    start |= _with_descriptors(component, graph, values, update.views, entering, start)
    other_start = {robot_key(component.keyframe + 1): update.predicted} | _turned_only(component, update.views)
    jumped = jumped or _turns_an_object(component, update.views)
    return Extension(
        graph=graph,
        values=values,
        measurements=[*classed, *entering],
        start=start,
        jumped=jumped,
        other_start=other_start,
    )


def linearisation_start(component: Component, update: ComponentUpdate) -> dict[int, Array]:
    """GTSAM key -> (s,) state at which a continuation's semantic measurements are linearised."""
    start = {robot_key(component.keyframe + 1): update.robot} | update.smoothed
    return start | {object_key(n): o for n, o in zip(update.object_ids, update.objects, strict=True)}


def new_factors(
    component: Component, shared: KeyframeFactors, update: ComponentUpdate
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Odometry, gravity, geometry and priors of new objects; and values of the new keys, the robot's where its mode is.

    What the keyframe measures is not among them where the smoother holds its measurements linear.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    if component.smoother.in_charts is None:
        graph.add(shared.odometry(component))
        if (level := shared.level()) is not None:
            graph.add(level)
        for item in update.observed:
            graph.add(shared.geometry(item))
    component.spaces.robot.insert(values, robot_key(component.keyframe + 1), update.robot)
    for number, prior in update.new_objects.items():
        graph.add(prior.factor(component.spaces.landmark, object_key(number)))
        component.spaces.landmark.insert(values, object_key(number), prior.mean)
    if update.errors is not None:
        _add_errors(component.keyframe + 1, update.errors, shared, graph, values)
    if shared.has_biases and begins_stretch(component.keyframe + 1) and component.tracked is not None:
        bias_change(component.keyframe + 1, component.tracked.bias, graph, values)
    return graph, values


def _add_errors(
    keyframe: int,
    errors: ErrorTransition,
    shared: KeyframeFactors,
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
) -> None:
    """Add the errors of a keyframe's detections that repeat."""
    graph.add(shared.errors(errors))
    keys = error_keys(keyframe, errors.count)
    for key, part in zip(keys, vector_parts(keys), strict=True):
        values.insert(key, errors.mean[part])


def classed_measurements(component: Component, update: ComponentUpdate) -> list[SemanticFactor]:
    """The semantic measurements of the next keyframe under an enumerated class."""
    key = robot_key(component.keyframe + 1)
    classed = [item for item in update.observed if item.assigned_class >= 0]
    return [
        SemanticFactor(
            robot_key=key,
            object_key=object_key(item.object_id),
            detection=item.detection,
            assigned_class=item.assigned_class,
        )
        for item in classed
    ]


def descriptor_measurements(views: Mapping[int, ObjectViews]) -> list[SemanticFactor]:
    """The semantic measurements that enter the graph with new records of objects."""
    return [
        SemanticFactor(
            robot_key=robot_key(keyframe),
            object_key=object_key(number),
            detection=detection,
            assigned_class=-1,
            descriptor_key=descriptor_key(number),
            exact=record.descriptor.is_bent,
        )
        for number, record in views.items()
        if record.descriptor is not None
        for keyframe, detection in record.descriptor.entering
    ]


def _with_descriptors(
    component: Component,
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    views: Mapping[int, ObjectViews],
    entering: Sequence[SemanticFactor],
    start: Mapping[int, Array],
) -> dict[int, Array]:
    """Add the variables E(n) that ``entering`` views need; states of all their variables that ``start`` lacks."""
    states: dict[int, Array] = {}
    for number, record in views.items():
        key, guess = descriptor_key(number), record.descriptor
        if guess is None or not guess.entering:
            continue
        states[key] = guess.mean
        if guess.heading_rad is not None:
            pose_key = object_key(number)
            states[pose_key] = np.append(start[pose_key][:-1], guess.heading_rad)
        if not component.smoother.has(key):
            prior = component.smoother.semantics.descriptor_prior(number)
            graph.add(gtsam.PriorFactorVector(key, prior.mean[0], gtsam.noiseModel.Diagonal.Sigmas(prior.sigma[0])))
            values.insert(key, guess.mean)
    lacking = sorted({key for item in entering for key in item.keys} - start.keys() - states.keys())
    known = zip(lacking, component.states(lacking), strict=True)
    return states | {key: component.spaces.own(key, state) for key, state in known}


def _turned_only(component: Component, views: Mapping[int, ObjectViews]) -> dict[int, Array]:
    """Where descriptors and the objects that their views turn begin, if all else stays as it was."""
    states: dict[int, Array] = {}
    for number, record in views.items():
        guess, pose_key = record.descriptor, object_key(number)
        if guess is None or not guess.entering:
            continue
        states[descriptor_key(number)] = guess.mean
        if guess.heading_rad is not None and component.smoother.has(pose_key):
            states[pose_key] = np.append(component.states([pose_key])[0, :-1], guess.heading_rad)
    return states


def _turns_an_object(component: Component, views: Mapping[int, ObjectViews]) -> bool:
    """Whether views that enter now turn an object: linear factors do not tell true from so far away."""
    return any(
        record.descriptor is not None
        and record.descriptor.heading_rad is not None
        and len(record.descriptor.entering) > 0
        and _turn(component, number, record.descriptor.heading_rad) > TURN_RAD
        for number, record in views.items()
    )


def _turn(component: Component, object_id: int, heading_rad: float) -> float:
    """Between an object's estimated heading and another; infinite for a new object."""
    key = object_key(object_id)
    if not component.smoother.has(key):
        return np.inf
    return float(np.abs(wrap_angle(component.states([key])[0, -1] - heading_rad)))


def _bounds(component: Component, update: ComponentUpdate) -> dict[int, float]:
    """How far objects that are seen along rays alone may be from where they are linearised: a share of their range.

    What tells of the range is the less linear the nearer they are, by metres alone nobody would see that.
    """
    if component.spaces.name != "spatial":
        return {}
    place = component.spaces.robot.position(update.robot)
    rays = [
        (item, state)
        for item, state in zip(update.observed, update.objects, strict=True)
        if not item.detection.has_range
    ]
    return {
        object_key(item.object_id): RANGE_SHARE
        * float(np.linalg.norm(component.spaces.landmark.position(state) - place))
        for item, state in rays
    }


def _jumped(component: Component, update: ComponentUpdate, moved: bool) -> bool:
    """Whether the continuation's mode is elsewhere than the estimate, or should be met exactly."""
    if update.window is not None or moved:
        return True
    past = [key for key in update.smoothed if component.smoother.has(key)]
    if not past:
        return False
    modes = [update.smoothed[key] for key in past]
    return component.spaces.largest_change(past, component.states(past), modes) > JUMP
