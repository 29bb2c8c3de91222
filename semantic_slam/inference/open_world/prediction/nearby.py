"""The objects that a keyframe may concern, and the joint covariance of robot and objects."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Index, places_among
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.existence import log_miss
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.prediction.predicted_robot import PredictedRobot
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.smoothing.local_map import LARGEST_AGE, LocalMap
from semantic_slam.inference.smoothing.tracking import motion_keys
from semantic_slam.inference.states.in_view import InViewRecord
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.states.tracked_objects import HypothesisObjects

LOCAL_OBJECTS = 40
"""Objects around robot and detections that a new local map holds besides those near the detections."""


def near_objects(
    settings: OpenWorldConfiguration,
    component: Component,
    robot: Array,
    spread: Array,
    births: list[Birth],
    detections: Sequence[Any],
    reach: Index,
    wanted: Collection[int] = (),
) -> tuple[Index, Array]:
    """(M,) rows of objects that a detection may belong to, and (D,) bounds on the evidence of those left out.

    All objects within reach where there are few; where they are too many, those with ``wanted`` ids and the best
    fitting others. Errors of robot and object are taken as independent, although shared errors bring them closer.
    """
    limit, gate = settings.max_joint_objects, settings.gate_sigma
    objects, tracked, geometry = component.objects, tracked_states(component), geometry_of(component.spaces)
    if len(objects.ids) <= limit:
        return reach, np.full(len(births), -np.inf)
    away = np.full((len(births), len(objects.ids)), np.inf)
    if births:
        away[:, reach] = geometry.sigmas_away(tracked, robot, spread, births, detections)[:, reach]
    excess = away.min(axis=0, initial=np.inf)
    named = np.isin(objects.ids, list(wanted))
    excess[named] = 0.0
    limit = max(limit, int(named.sum()))
    order = np.argsort(excess, kind="stable")
    order = order[excess[order] < gate]
    peaks = np.array([detection.log_normaliser for detection in detections])
    detected = objects.existence[order[limit:]] * objects.rates.average(objects.rates.probability)
    weights = -0.5 * away[:, order[limit:]] ** 2 + np.log(detected) - log_miss(detected, np.ones(len(detected)))
    beyond = peaks + np.logaddexp.reduce(weights, axis=1, initial=-np.inf)
    return np.sort(order[:limit]), np.asarray(beyond)


def local_around(component: Component, robot: Array, near: Index, ahead: Index) -> LocalMap:
    """The local map of the newest robot pose and near objects; read from the smoother where the last one will not do.

    Reading costs as much as eliminating the whole drive again, so objects that may be near next, ``ahead`` (n,), are
    included.
    """
    tracked, known = tracked_states(component), component.local
    ids = component.objects.ids[near]
    if known is not None and known.age < LARGEST_AGE and known.holds(ids):
        return known
    if component.single_steps:
        amid = robot[:2] if not len(near) else 0.5 * (robot[:2] + tracked.states[near, :2].mean(axis=0))
        around = np.argsort(geometry_of(component.spaces).distances(tracked.states, amid), kind="stable")[
            :LOCAL_OBJECTS
        ]
        ids = component.objects.ids[np.union1d(np.union1d(near, ahead), around)]
    keys = motion_keys(component.keyframe, len(tracked.bias), tracked.errors)
    together = tracked.motion_covariance.copy()
    if len(ids):
        together = component.joint_covariance([*keys, *(object_key(int(n)) for n in ids)])
    return LocalMap(
        layout=component.spaces.layout,
        ids=ids,
        robot=tracked.robot,
        objects=tracked.states[component.objects.rows(ids)],
        covariance=together,
        num_biases=len(tracked.bias),
        num_errors=tracked.num_errors,
    )


def objects_in_reach(
    component: Component, robot: PredictedRobot, reach: Index, near: Index, predicted: PredictedBelief
) -> PredictedObjects:
    """Objects within range given the ``robot``; those without a known cross-covariance are taken to move with it."""
    r, landmark = predicted.layout.robot, predicted.layout.landmark
    spread = predicted.covariance[0, :r, :r]
    states = tracked_states(component).states[reach]
    gain = geometry_of(component.spaces).moving_along(robot.state, states)
    remainder = np.zeros((len(reach), landmark, landmark))
    known, inside = places_among(reach, near)
    if inside.any():
        joint = predicted.pair_covariances[0, inside]
        cross = joint[:, r:, :r]  # (m, l, r) of object with robot
        own = cross @ np.linalg.inv(spread)
        gain[known[inside]] = own
        remainder[known[inside]] = joint[:, r:, r:] - own @ np.swapaxes(cross, 1, 2)
    return PredictedObjects(
        robot=robot.state,
        robot_covariance=spread,
        objects=states,
        gain=gain,
        remainder=remainder,
        in_view=in_view_of(component.objects).take(reach).with_rates(component.objects.rates.sensor_rows),
        robot_before=component.spaces.robot.between(robot.state, tracked_states(component).robot),
        motion_noise=robot.noise.covariance,
    )


def in_view_of(objects: HypothesisObjects) -> InViewRecord:
    """What is known of being in view, of all O objects; nothing where no keyframe has accounted for it."""
    if objects.in_view is None:
        return InViewRecord.unknown(None, *objects.existence_given.shape)
    return objects.in_view
