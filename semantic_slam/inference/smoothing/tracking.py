"""Tracked states: robot and objects after an update, kept where reading every marginal from iSAM2 costs too much."""

from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.local_map import LocalMap
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import bias_key, error_keys, object_key, robot_key
from semantic_slam.inference.states.propagated_errors import PropagatedErrors
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import TrackedStates


def tracked_before(
    spaces: Spaces, robot: GaussianPrior, objects: list[GaussianPrior], num_biases: int
) -> TrackedStates:
    """Tracked states before any keyframe: the priors of the robot and of a map's objects, ascending by id."""
    storage, size = spaces.storage, spaces.layout.landmark
    covariances = np.array([prior.covariance for prior in objects]).reshape(-1, size, size)
    return TrackedStates(
        states=np.array([prior.mean for prior in objects]).reshape(-1, storage.landmark),
        covariances=covariances,
        sigmas=_position_sigmas(spaces, covariances),
        robot=robot.mean,
        robot_covariance=robot.covariance,
        trail=np.zeros((0, storage.robot)),
        bias=np.zeros(num_biases),
        propagated_covariance=_with_unit_bias(robot.covariance, num_biases),
    )


def tracked_after(
    smoother: Smoother, keyframe: int, before: TrackedStates, ids: Index, update: ComponentUpdate, max_fresh: int
) -> tuple[TrackedStates, LocalMap | None]:
    """Tracked states after one keyframe, over the objects ``ids`` (O,), and the update's local map at them.

    Marginal covariances are recomputed of the objects observed and of all, if there are no more than ``max_fresh``.
    Raises LostComponentError.
    """
    layout, storage, existence = smoother.spaces.layout, smoother.spaces.storage, update.existence
    new = len(existence.new_ids)
    states = smoother.states([*(object_key(int(n)) for n in ids), robot_key(keyframe)])
    unknown = np.zeros((new, layout.landmark, layout.landmark))
    covariances = np.concatenate([before.covariances[existence.kept], unknown])
    sigmas = np.concatenate([before.sigmas[existence.kept], np.zeros(new)])
    fresh = np.arange(len(ids))
    if len(ids) > max_fresh:
        fresh = np.unique(np.searchsorted(ids, update.object_ids)).astype(int)
    errors = _errors_after(smoother, keyframe, before, update)
    robot, objects = states[-1, : storage.robot], states[:-1, : storage.landmark]
    local = None if update.local is None else update.local.at_estimates(ids, robot, objects)
    together, covariances[fresh] = _joint(smoother, keyframe, len(before.bias), errors, local, ids[fresh])
    sigmas[fresh] = _position_sigmas(smoother.spaces, covariances[fresh])
    tracked = TrackedStates(
        states=objects,
        covariances=covariances,
        sigmas=sigmas,
        robot=robot,
        robot_covariance=together[: layout.robot, : layout.robot],
        trail=np.concatenate([before.trail, states[-1:, : storage.robot]]),
        bias=smoother.vector(bias_key(keyframe)) if len(before.bias) else before.bias,
        errors=errors,
        anchors=_anchors_after(before, update),
        propagated_covariance=together if len(before.bias) or errors is not None else None,
    )
    return tracked, local


def tracked_again(smoother: Smoother, keyframe: int, before: TrackedStates, ids: Index) -> TrackedStates:
    """Tracked states where a smoother in space was optimised again, over the objects ``ids`` (O,); else as before."""
    if smoother.spaces.name != "spatial":
        return before
    storage = smoother.spaces.storage
    states = smoother.states([*(object_key(int(n)) for n in ids), robot_key(keyframe)])
    return replace(before, states=states[:-1, : storage.landmark], robot=states[-1, : storage.robot])


def _anchors_after(before: TrackedStates, update: ComponentUpdate) -> Array | None:
    """(O, 3) position from which an object was first seen along a ray alone, NaN for others; None where none was."""
    kept = update.existence.kept
    new = [update.new_objects[int(n)].anchor for n in update.existence.new_ids]
    if before.anchors is None and all(anchor is None for anchor in new):
        return None
    known = np.full((len(kept), 3), np.nan) if before.anchors is None else before.anchors
    rows = [np.full(3, np.nan) if anchor is None else anchor for anchor in new]
    return np.concatenate([known[kept], np.array(rows, dtype=np.float64).reshape(-1, 3)])


def _errors_after(
    smoother: Smoother, keyframe: int, before: TrackedStates, update: ComponentUpdate
) -> PropagatedErrors | None:
    """The correlated errors, as of the newest frame with detections."""
    if update.errors is None:
        return before.errors if update.propagated_errors is None else update.propagated_errors
    keys = error_keys(keyframe, update.errors.count)
    return update.errors.after(keyframe, np.concatenate([smoother.vector(key) for key in keys]))


def _joint(
    smoother: Smoother,
    keyframe: int,
    num_biases: int,
    errors: PropagatedErrors | None,
    local: LocalMap | None,
    object_ids: Index,
) -> tuple[Array, Array]:
    """(r + p + q) square of robot, biases and errors, and (n, l, l) of objects: from the local map if it holds them."""
    if local is not None and local.holds(object_ids):
        return local.covariance[local.propagated, local.propagated], local.single(object_ids)
    own_keys, keys = motion_keys(keyframe, num_biases, errors), [object_key(n) for n in object_ids.tolist()]
    if smoother.spaces.name == "spatial":
        return _read_at_once(smoother, own_keys, keys)
    return smoother.joint_covariance(own_keys), smoother.covariances(keys)


def _read_at_once(smoother: Smoother, own_keys: list[int], objects: list[int]) -> tuple[Array, Array]:
    """Covariances of robot, biases and errors, and of objects, from a joint one that the next prediction needs."""
    layout = smoother.spaces.layout
    joint = smoother.joint_covariance([*own_keys, *objects])
    first = len(joint) - layout.landmark * len(objects)
    blocks = joint[first:, first:].reshape(len(objects), layout.landmark, len(objects), layout.landmark)
    numbers = np.arange(len(objects))
    return joint[:first, :first].copy(), blocks[numbers, :, numbers]


def motion_keys(keyframe: int, num_biases: int, errors: PropagatedErrors | None) -> list[int]:
    """Keys of the newest robot, the biases of its odometry, and the correlated errors."""
    repeated = [] if errors is None else error_keys(errors.keyframe, errors.count)
    return [robot_key(keyframe), *[bias_key(keyframe)][:num_biases], *repeated]


def _position_sigmas(spaces: Spaces, covariances: Array) -> Array:
    """(O,) largest standard deviations of the positions of objects [m], from (O, l, l)."""
    rows = spaces.landmark.position_rows
    return largest_sigmas(covariances[:, rows, rows])


def _with_unit_bias(robot: Array, num_biases: int) -> Array | None:
    """Joint covariance of the robot and unit-variance prior biases; None without biases."""
    if not num_biases:
        return None
    size = len(robot)
    together = np.eye(size + num_biases)
    together[:size, :size] = robot
    return together
