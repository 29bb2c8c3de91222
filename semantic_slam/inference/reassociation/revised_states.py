"""Objects, existence and tracked states after a reassociation of earlier detections."""

from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.moments import position_sigmas
from semantic_slam.inference.open_world.existence import LEAST_PROBABILITY
from semantic_slam.inference.reassociation.accounts import StretchAccount
from semantic_slam.inference.reassociation.atoms import Atoms
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.smoothing.tracking import motion_keys
from semantic_slam.inference.states.keys import bias_key, error_keys, object_key, robot_key
from semantic_slam.inference.states.tracked_objects import HypothesisObjects, TrackedStates


def revised_objects(
    objects: HypothesisObjects, atoms: Atoms, before: StretchAccount, after: StretchAccount, log_weights: Array
) -> HypothesisObjects:
    """The objects after reassociation, each with the state of the object that its newest detection was of before.

    The existence of one whose newest detection is another now follows from the account. That of one without detections
    in the stretch is updated by the ratio of miss likelihoods, as the path, and with it what was in view, has changed.
    ``log_weights`` (G,): the new weights of the settings.
    """
    source = dict(zip(after.ids.tolist(), after.ids.tolist(), strict=True))
    source |= dict(zip(atoms.objects.tolist(), atoms.sighted.objects.tolist(), strict=True))
    newest = np.array([source[number] for number in after.ids.tolist()], dtype=int)
    rows = objects.rows(newest)
    existence = objects.existence_given[rows].copy()
    seen_last = before.last_seen[rows] != after.last_seen
    existence[seen_last] = after.existence[seen_last]
    missed = ~seen_last & ~after.seen[:, after.begin :].any(axis=1)
    odds = existence[missed] * np.exp(after.log_if_there - before.log_if_there[rows])[missed]
    existence[missed] = odds / np.maximum(odds + 1.0 - existence[missed], LEAST_PROBABILITY)
    return replace(
        objects,
        ids=after.ids,
        existence_given=existence,
        in_view=None if objects.in_view is None else objects.in_view.take(rows),
        gone=None if objects.gone is None else objects.gone[rows],
        track_scores=None
        if objects.track_scores is None
        else _track_scores(objects, objects.track_scores, after.ids, newest),
        rates=replace(objects.rates, log_weights=log_weights),
    )


def _track_scores(objects: HypothesisObjects, scores: Array, ids: Index, newest: Index) -> Array:
    """(N, G) track scores of objects ``ids`` (N,), whose newest detections were of objects ``newest`` (N,) before.

    Of an object that took over all of another one's detections it is the sum, as if all had been of it from the first:
    within a third of what a replay says. Of one that took over some, it is the larger one.
    """
    found = scores[objects.rows(newest)]
    own = np.flatnonzero(np.isin(ids, objects.ids) & (ids != newest))
    before = scores[objects.rows(ids[own])]
    is_whole = ~np.isin(newest[own], ids)[:, None]
    found[own] = np.where(is_whole, found[own] + before, np.maximum(found[own], before))
    return np.asarray(found)


def revised_tracking(component: Component, smoother: Smoother, ids: Index) -> TrackedStates:
    """Tracked states of the robot and of objects ``ids`` (O,) after reassociation.

    Covariances of objects that stay are those of when they were last near. Raises LostComponentError.
    """
    before, keyframe = tracked_states(component), component.keyframe
    storage, layout = smoother.spaces.storage, smoother.spaces.layout
    states = smoother.states([object_key(int(n)) for n in ids])[:, : storage.landmark]
    path = smoother.states([robot_key(k) for k in range(keyframe + 1)])[:, : storage.robot]
    covariances = np.zeros((len(ids), layout.landmark, layout.landmark))
    known = np.isin(ids, component.objects.ids)
    covariances[known] = before.covariances[component.objects.rows(ids[known])]
    covariances[~known] = smoother.covariances([object_key(int(n)) for n in ids[~known]])
    errors = before.errors
    if errors is not None:
        keys = error_keys(errors.keyframe, errors.count)
        errors = replace(errors, mean=np.concatenate([smoother.vector(key) for key in keys]))
    together = smoother.joint_covariance(motion_keys(keyframe, len(before.bias), errors))
    propagates = len(before.bias) > 0 or errors is not None
    return replace(
        before,
        states=states,
        covariances=covariances,
        sigmas=position_sigmas(covariances),
        robot=path[-1],
        robot_covariance=together[: layout.robot, : layout.robot],
        trail=path,
        bias=smoother.vector(bias_key(keyframe)) if len(before.bias) else before.bias,
        errors=errors,
        propagated_covariance=together if propagates else None,
    )
