"""Screening of partial associations by one linear (Kalman) step, which spares the search for most modes.

Candidates that the step shows to be far off are dropped; nearly linear ones are ranked by it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, column_products
from semantic_slam.geometry.rows import take
from semantic_slam.geometry.small_matrices import backward
from semantic_slam.inference.association.partial_assignments import PartialAssignments
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.evidence.laplace import Mode
from semantic_slam.inference.evidence.search_start import search_start
from semantic_slam.inference.models.observation import Innovation, ObservationModel
from semantic_slam.inference.states.spaces import Spaces

RANKED_RAD = 0.1
"""Sigma of the bearing, given the other detections, below which one linear step ranks as well as a search does.

For a detection that is off by n > 1 standard deviations the threshold is n times smaller.
"""
STEADY_RAD = 0.2
"""Sigma of the bearing, given the other detections, below which one linear step may drop candidates."""
LOST_RAD = 0.3
"""Sigma of the bearing above which a search from the expected state may end in a mode that is not the best."""
SAFETY = 2.0
"""Factor on the gate for dropping by a linear step, as the neglected nonlinearity may change its nats that much."""


@dataclass(frozen=True, kw_only=True)
class ScreenedAssignments:
    """The K candidates that are left of B after screening."""

    prefixes: PartialAssignments  # K, with the newest detection
    stack: KeyframeProblem  # K
    mode: Mode  # K, from one linear step where that suffices for ranking; else the state to search from
    searched: Index  # those of K whose modes still have to be searched
    log_left_out: Array  # (P,) log mass of the dropped ones, relative to the parent's best by one linear step


def screen(
    prefixes: PartialAssignments,
    previous: Mode,
    origin: Index,
    objects: Index,
    model: ObservationModel,
    detections: Any,
    gate: float,
    log_clutter: Array | None = None,
) -> ScreenedAssignments:
    """Drop candidates whose evidence, by one linear step from the previous mode, is far behind the parent's best.

    ``previous`` are the modes of the prefixes; candidate b extends prefix ``origin[b]``, the newest of ``detections``
    being of ``objects[b]``, or clutter (-1) of log density ``log_clutter`` (n,). Only candidates whose step can be
    trusted are dropped. Of the others, the nearly linear ones start at that step, those with large bearing uncertainty
    at whichever start fits best, and the rest at the previous mode.
    """
    known = np.asarray(np.linalg.inv(previous.hessian))
    expected = _expected(prefixes, previous, known)
    number = prefixes.rows.objects.shape[1]
    newest = _newest(expected, origin, np.maximum(objects, 0), model, detections.take([number]))
    if log_clutter is not None:
        newest = newest.but(objects < 0, float(log_clutter[number]))
    linear, parents = newest.sigma < STEADY_RAD, prefixes.rows.parents[origin]
    evidence = previous.log_evidence[origin] + newest.log_density
    best = np.full(len(prefixes.predicted.mean), -np.inf)
    np.maximum.at(best, parents[linear], evidence[linear])
    behind = evidence - best[parents]
    dropped = linear & (behind < -SAFETY * gate)
    left_out = np.full(len(best), -np.inf)
    np.logaddexp.at(left_out, parents[dropped], behind[dropped])
    kept = np.flatnonzero(~dropped)
    longer = prefixes.extended(origin[kept], objects[kept])
    stack = longer.stack(model, detections, log_clutter)
    start, step, hessian = _stepped(stack, previous.take(origin[kept]), known[origin[kept]], newest.take(kept))
    start[linear[kept]] += step[linear[kept]]
    lost = np.flatnonzero(newest.sigma[kept] > LOST_RAD)
    if len(lost):
        start[lost] = _better_start(stack.select(lost), start[lost])
    ranked = newest.sigma * np.maximum(newest.off, 1.0) < RANKED_RAD
    return ScreenedAssignments(
        prefixes=longer,
        stack=stack,
        mode=Mode(start, hessian, evidence[kept]),
        searched=np.flatnonzero(~ranked[kept]),
        log_left_out=left_out,
    )


@dataclass(frozen=True, kw_only=True)
class _Expected:
    """Robot and all objects given the modes of B prefixes; covariances in the tangent spaces at the prior means."""

    spaces: Spaces
    states: Array  # (B, 1 + O, s)
    charts: Array  # (B, 1 + O, w, w) Jacobians of the retraction: from those to the tangent spaces at ``states``
    covariances: Array  # (B, 1 + O, w, w) marginal covariances
    with_robot: Array  # (B, 1 + O, r, w) cross covariances of the robot with each

    def pairs(self, origin: Index, objects: Index) -> tuple[Array, Array]:
        """(K, r + l, r + l) joint covariances of the robot and one object each, and their retraction Jacobians."""
        layout, place = self.spaces.layout, 1 + objects
        r, landmark, shape = layout.robot, slice(layout.landmark), (len(origin), layout.size(1), layout.size(1))
        covariance, charts = np.empty(shape), np.zeros(shape)
        covariance[:, :r, :r], covariance[:, r:, r:] = (
            self.covariances[origin, 0, :r, :r],
            self.covariances[origin, place, landmark, landmark],
        )
        covariance[:, :r, r:] = self.with_robot[origin, place, :, landmark]
        covariance[:, r:, :r] = np.swapaxes(covariance[:, :r, r:], 1, 2)
        charts[:, :r, :r], charts[:, r:, r:] = (
            self.charts[origin, 0, :r, :r],
            self.charts[origin, place, landmark, landmark],
        )
        return covariance, charts


def _expected(prefixes: PartialAssignments, previous: Mode, known: Array) -> _Expected:
    """Condition all states on the modes of the prefixes; ``known`` (B, m, m): inverse Hessians, i.e. covariances."""
    spaces, predicted, parents = prefixes.spaces, prefixes.predicted, prefixes.rows.parents
    mean, layout, flat, blocks = predicted.mean[parents], spaces.layout, prefixes.cross, prefixes.cross_blocks
    moved, charts = spaces.joint.exp_and_jacobian(layout.blocks(column_products(previous.y[:, None], flat)[:, 0]))
    explained = column_products(np.eye(flat.shape[1]) - known, flat)
    by_state = np.ascontiguousarray(np.moveaxis(layout.blocks(explained), 1, 2))
    explained_blocks = np.ascontiguousarray(np.moveaxis(blocks, 1, 3)) @ by_state
    robot = np.ascontiguousarray(np.swapaxes(blocks[:, :, 0, : layout.robot], 1, 2))
    with_robot = np.swapaxes(layout.blocks(column_products(robot, explained)), 1, 2)
    states = np.arange(mean.shape[1])
    diagonal = np.moveaxis(predicted.blocks[:, states, :, states], 0, 1)
    first = np.swapaxes(predicted.blocks[:, 0, : layout.robot], 1, 2)
    at = spaces.joint.compose(mean, moved)
    return _Expected(
        spaces=spaces,
        states=at,
        charts=charts,
        covariances=diagonal[parents] - explained_blocks,
        with_robot=first[parents] - with_robot,
    )


@dataclass(frozen=True, kw_only=True)
class _Newest:
    """The newest detection of B candidates, linearised at the mode of the others; m components of a residual."""

    jacobian: Array  # (B, m, r + l) of its whitened residual by the tangents of robot and object at their prior means
    gain: Array  # (B, m) inverse covariance of that residual, times it
    log_density: Array  # (B,) of the detection given the others
    sigma: Array  # (B,) radians by which the direction of sight is uncertain, given the others
    off: Array  # (B,) standard deviations by which the detection is off

    def take(self, rows: Index) -> "_Newest":
        return take(self, rows)

    def but(self, clutter: Flags, log_density: float) -> "_Newest":
        """The detection with clutter rows (B,) replaced: clutter has zero gain, no nonlinearity and a fixed density."""
        return _Newest(
            jacobian=np.where(clutter[:, None, None], 0.0, self.jacobian),
            gain=np.where(clutter[:, None], 0.0, self.gain),
            log_density=np.where(clutter, log_density, self.log_density),
            sigma=np.where(clutter, 0.0, self.sigma),
            off=np.where(clutter, 0.0, self.off),
        )


def _newest(expected: _Expected, origin: Index, objects: Index, model: ObservationModel, detection: Any) -> _Newest:
    """Linearise the newest detection and compute one Kalman update for each candidate."""
    storage = expected.spaces.storage
    x = expected.states[origin, 0, : storage.robot]
    o = expected.states[origin, 1 + objects, : storage.landmark]
    covariance, charts = expected.pairs(origin, objects)
    part = model.geometry(detection, x, o)
    jacobian = np.concatenate([part.jacobian_robot, part.jacobian_object], axis=-1) @ charts
    innovation = Innovation.of(part, jacobian, covariance)
    gain = backward(innovation.root, innovation.whitened[..., None])[..., 0]
    sigma = model.bearing_sigma(x, o, covariance, charts)
    return _Newest(
        jacobian=jacobian, gain=gain, log_density=innovation.log_density, sigma=sigma, off=innovation.distance
    )


def _stepped(stack: KeyframeProblem, previous: Mode, known: Array, newest: _Newest) -> tuple[Array, Array, Array]:
    """(K, n) whitened states at the previous modes, linear steps from there with the newest detection, and Hessians."""
    count, before, layout = len(stack.root), previous.y.shape[1], stack.layout
    start = np.concatenate([previous.y, np.zeros((count, stack.size - before))], axis=1)
    blocks = np.stack([np.zeros(count, dtype=int), 1 + stack.slots[:, -1]], axis=1)
    slopes = layout.blocks(stack.root, -2)[np.arange(count)[:, None], blocks]  # (K, 2, w, n)
    jacobian = newest.jacobian @ layout.joined(slopes, -2)
    transposed = np.ascontiguousarray(np.swapaxes(jacobian, 1, 2))
    step = -(transposed @ newest.gain[..., None])
    step[:, :before] = known @ step[:, :before]
    hessian = transposed @ jacobian
    hessian[:, :before, :before] += previous.hessian
    new = np.arange(before, stack.size)
    hessian[:, new, new] += 1.0
    return start, step[..., 0], hessian


def _better_start(stack: KeyframeProblem, carried: Array) -> Array:
    """Search start: the previous mode (``carried``) or a start that explains one detection, whichever fits better."""
    fresh = search_start(stack)
    better = stack.energy(carried) <= stack.energy(fresh)
    return np.where(better[:, None], carried, fresh)
