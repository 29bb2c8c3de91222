"""Factors and variables that a continuation of a component adds to its smoother (Eqs. 4.9-4.11)."""

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
"""Change of the robot's predicted state [m or rad] from which on the whole graph is reoptimised."""
TURN_RAD = 0.3
"""Change of an object's heading [rad] from which on the whole graph is reoptimised."""


def extension(component: Component, shared: KeyframeFactors, update: ComponentUpdate, *, moved: bool) -> Extension:
    """Factors, variables and semantic measurements of one continuation.

    ``moved``: the mode of its robot is far from the odometry prediction.
    """
    graph, values = new_factors(component, shared, update)
    classed, jumped = classed_measurements(component, update), _jumped(component, update, moved)
    start = linearisation_start(component, update)
    if component.smoother.semantics.latent is None:
        along_rays = component.smoother.along_rays or _along_rays(component, update)
        return Extension(
            graph=graph,
            values=values,
            measurements=classed,
            start=start,
            jumped=jumped or along_rays != component.smoother.along_rays,
            along_rays=along_rays,
        )
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
    """Odometry, gravity, geometry and priors of new objects, and initial values of new keys (the robot's at its mode).

    Where the smoother holds measurements linear in charts, odometry, gravity and detections are not among the factors.
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
        for factor in prior.factors(component.spaces.landmark, object_key(number)):
            graph.add(factor)
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
    """Add the variables and factor of a keyframe's correlated detection errors."""
    graph.add(shared.errors(errors))
    keys = error_keys(keyframe, errors.count)
    for key, part in zip(keys, vector_parts(keys), strict=True):
        values.insert(key, errors.mean[part])


def classed_measurements(component: Component, update: ComponentUpdate) -> list[SemanticFactor]:
    """The semantic measurements of the next keyframe with an enumerated class."""
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
    """The semantic measurements that enter the graph with new view records of objects."""
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
    """Add the descriptor variables E(n) of ``entering`` views; states of their variables that ``start`` lacks."""
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
    """Initial descriptors and headings of the objects that new views turn, with all else unchanged."""
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
    """Whether new views turn an object so far that linear factors do not hold."""
    return any(
        record.descriptor is not None
        and record.descriptor.heading_rad is not None
        and len(record.descriptor.entering) > 0
        and _turn(component, number, record.descriptor.heading_rad) > TURN_RAD
        for number, record in views.items()
    )


def _turn(component: Component, object_id: int, heading_rad: float) -> float:
    """Angle between an object's estimated heading and another one [rad]; infinite for a new object."""
    key = object_key(object_id)
    if not component.smoother.has(key):
        return np.inf
    return float(np.abs(wrap_angle(component.states([key])[0, -1] - heading_rad)))


def _along_rays(component: Component, update: ComponentUpdate) -> bool:
    """Whether an object in space is seen by a ray alone."""
    return component.spaces.name == "spatial" and any(not item.detection.has_range for item in update.observed)


def _jumped(component: Component, update: ComponentUpdate, moved: bool) -> bool:
    """Whether the continuation's mode is far from the estimate, or is to be reached exactly."""
    if update.window is not None or moved:
        return True
    past = [key for key in update.smoothed if component.smoother.has(key)]
    if not past:
        return False
    modes = [update.smoothed[key] for key in past]
    return component.spaces.largest_change(past, component.states(past), modes) > JUMP
