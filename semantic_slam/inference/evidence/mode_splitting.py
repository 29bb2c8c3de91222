"""Mode splitting: heavy candidates are sampled, and split into their modes where they are not one Gaussian."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import WeightsConfiguration
from semantic_slam.geometry.arrays import Array, Index, row_sums, squared_norms
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.importance import normal_points
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.evidence.laplace import Mode
from semantic_slam.inference.evidence.mode_search import SearchStart, search_modes
from semantic_slam.inference.evidence.posterior_mode import PosteriorMode
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations
from semantic_slam.inference.evidence.window import Anchor, Window, WindowStep
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import object_key, robot_key

FEW_SAMPLES = 16
"""Samples that suffice for a clearly Gaussian candidate, to compute its evidence and to show that it is Gaussian.

Its sample weights hardly differ, and its objects are well visible.
"""
CLEAR_SHARE = 0.995
"""Effective sample share of those above which weights hardly differ.

None of 299 such candidates had a share below 0.95 among 64 samples.
"""
LOG_IN_SIGHT = -0.02
"""Soft log visibility of all objects together above which they are well inside every visibility limit."""


@dataclass(frozen=True, kw_only=True)
class UnsplitCandidates:
    """K candidates before splitting, one for each association and class assignment."""

    step: Step
    parents: Sequence[Anchor]
    log_parent_weights: Array  # (P,)
    candidates: WeighedAssociations
    used: Index  # (n,) detections that the candidates are about
    new: Sequence[dict[int, GaussianPrior]]  # P: objects that this keyframe introduces
    log_level: Array  # (P,) log density of the measurement of gravity; the problems are given it, windows contain it
    is_cut_off: bool = False  # whether limits of visibility cut Gaussians off, which samples are to show

    @property
    def stack(self) -> KeyframeProblem:
        """The least-squares problems of the candidates."""
        return self.candidates.solved()[0]

    @property
    def mode(self) -> Mode:
        """The modes of those problems."""
        return self.candidates.solved()[1]

    @property
    def log_prior(self) -> Array:
        """(K,) log prior of the classes that are enumerated at this keyframe."""
        return self.candidates.assignments.column("log_class_prior")

    @property
    def object_ids(self) -> Index:
        """(O,) ids of the objects that associations refer to."""
        return self.candidates.object_ids

    def taken(self, row: int) -> WindowStep:
        """The window step of one candidate: the motion, and the detections with its associations."""
        rows = self.candidates.assignments.take([row])
        chosen = replace(self.candidates, assignments=rows).steps(self.used, len(self.step.names))[0]
        return WindowStep(self.step.motion, self.step.observed(chosen.association, chosen.class_assignment, self.used))

    def states_of(self, row: int, refined: PosteriorMode) -> Array:
        """(1 + n, s) states of the blocks of one candidate at a mode of its whole window."""
        states: Array = self.stack.mean[row].copy()
        storage = self.stack.spaces.storage
        robot = refined.smoothed[robot_key(self.parents[self.stack.rows.parents[row]].keyframe + 1)]
        states[0, : storage.robot] = robot
        for slot, place in enumerate(self.stack.rows.objects[row]):
            if place >= 0 and self.stack.slots[row, slot] == slot:
                mode = refined.smoothed[object_key(int(self.object_ids[place]))]
                states[1 + slot, : storage.landmark] = mode
        return states


def split_modes(
    expanded: UnsplitCandidates, weights: WeightsConfiguration, path_mode: int | None
) -> WeighedAssociations:
    """All modes of all candidates. ``path_mode``: mode number of a replayed lineage; for 0 no window is searched."""
    log_visible = expanded.stack.log_visibility(expanded.mode.y, soft=True)
    log_level = expanded.log_level[expanded.stack.rows.parents]
    log_evidence = expanded.mode.log_evidence + log_visible + log_level
    effective = np.full(len(log_evidence), np.nan)
    has_window = np.array([parent.window is not None for parent in expanded.parents])[expanded.stack.rows.parents]
    is_cut = ((log_visible < 0.0) | has_window) & expanded.is_cut_off
    heavy = _heavy(expanded, log_evidence, is_cut, weights.importance_gate, path_mode)
    plain = heavy & ~has_window
    shares = np.zeros(len(log_evidence))
    if plain.any():
        rows, counts = np.flatnonzero(plain), np.zeros(len(shares), dtype=int)
        for count in (FEW_SAMPLES, weights.screening_samples):
            geometric, shares[rows] = _screened(expanded, rows, log_evidence[rows] - log_level[rows], count)
            log_evidence[rows] = geometric + log_level[rows]
            counts[rows] = count
            rows = rows[(shares[rows] < CLEAR_SHARE) | (log_visible[rows] < LOG_IN_SIGHT)]
        effective[plain] = (shares * counts)[plain]
    look = heavy & (shares < weights.gaussian_share) if path_mode is None else heavy
    rows = np.flatnonzero(look)
    if not len(rows) and not has_window.any():
        return expanded.candidates.gaining(log_evidence=log_evidence, effective_sample_sizes=effective)
    modes_of: list[list[PosteriorMode]] = [[] for _ in log_evidence]
    for row, modes in zip(rows, search_modes(_starts(expanded, rows), weights), strict=True):
        modes_of[row] = modes
    origin, columns = _collected(expanded, modes_of, log_evidence, effective, weights)
    return _at_posterior_modes(expanded, origin, expanded.candidates.assignments.take(origin).gaining(**columns))


def _heavy(
    expanded: UnsplitCandidates,
    log_evidence: Array,
    is_cut: NDArray[np.bool_],
    gate: float,
    path_mode: int | None,
) -> NDArray[np.bool_]:
    """(K,) whether a candidate is heavy enough that its weight, or the moments of one without a rival, be exact.

    The weight of one without a rival is known; it is sampled only where limits of visibility cut its Gaussian, see
    ``is_cut`` (K,).
    """
    if path_mode is not None:
        return np.full(len(log_evidence), path_mode > 0)
    parents = expanded.stack.rows.parents
    score = log_evidence + expanded.log_prior
    best = np.full(len(expanded.parents), -np.inf)
    np.maximum.at(best, parents, score)
    heavy = expanded.log_parent_weights[parents] + score - best[parents] >= -gate
    alone = np.bincount(parents, minlength=len(best)) == 1
    certain = expanded.log_parent_weights >= np.log1p(-1e-9)
    return np.asarray(heavy & (is_cut | ~(alone & certain)[parents]))


def _screened(expanded: UnsplitCandidates, rows: Index, laplace: Array, count: int) -> tuple[Array, Array]:
    """(R,) log evidence by samples about the mode, and their effective share."""
    half = normal_points(count // 2, expanded.stack.size)
    points = np.concatenate([half, -half])
    roots = np.linalg.cholesky(expanded.mode.hessian[rows])
    deviations = np.swapaxes(np.linalg.inv(roots), 1, 2) @ points.T
    y = expanded.mode.y[rows][:, None] + np.swapaxes(deviations, 1, 2)
    logs = expanded.stack.select(rows).log_joint(y) + 0.5 * squared_norms(points)
    logs -= row_sums(np.log(np.diagonal(roots, axis1=1, axis2=2)))[:, None]
    is_finite = np.isfinite(logs).any(axis=1)
    largest = np.where(is_finite, logs.max(axis=1), 0.0)
    weights = np.exp(logs - largest[:, None])
    total = np.maximum(weights.sum(axis=1), 1e-300)
    shares = np.where(is_finite, total**2 / np.maximum((weights**2).sum(axis=1), 1e-300) / len(points), 0.0)
    estimate = largest + np.log(total / len(points))
    return np.where(is_finite, estimate, laplace), shares


def _starts(expanded: UnsplitCandidates, rows: Index) -> list[SearchStart]:
    """Windows of some candidates, with start states from their parents' estimates and their own modes."""
    part = expanded.stack.select(rows)
    return [_start(expanded, row, states) for row, states in zip(rows, part.states(expanded.mode.y[rows]), strict=True)]


def _start(expanded: UnsplitCandidates, row: int, states: Array) -> SearchStart:
    parent, storage = expanded.parents[expanded.stack.rows.parents[row]], expanded.stack.spaces.storage
    new = expanded.new[expanded.stack.rows.parents[row]]
    window = Window.of(parent).with_keyframe(expanded.taken(row), new)
    estimates = {
        int(expanded.object_ids[place]): states[1 + expanded.stack.slots[row, number]]
        for number, place in enumerate(expanded.stack.rows.objects[row])
        if place >= 0
    }
    past = range(window.anchor.keyframe, parent.keyframe + 1)
    robots = np.concatenate([parent.states([robot_key(k) for k in past]), states[:1]])[:, : storage.robot]
    objects = [estimates[n] if n in estimates else parent.states([object_key(n)])[0] for n in window.object_ids()]
    by_object = np.array(objects).reshape(-1, storage.width)[:, : storage.landmark]
    return SearchStart(window, robots, by_object)


def _collected(
    expanded: UnsplitCandidates,
    modes_of: list[list[PosteriorMode]],
    log_evidence: Array,
    effective: Array,
    weights: WeightsConfiguration,
) -> tuple[Index, dict[str, Any]]:
    """(M,) candidate of each mode, and the modes' columns for the table of assignments."""
    origin, number, evidence, sizes = [], [], [], []
    refined: list[PosteriorMode | None] = []
    windows: list[Window | None] = []
    for row, modes in enumerate(modes_of):
        parent = expanded.parents[expanded.stack.rows.parents[row]]
        before = parent.window.log_evidence if parent.window is not None else 0.0
        for at, mode in enumerate(modes):
            origin.append(row)
            number.append(1 + at)
            evidence.append(mode.log_evidence - before + float(expanded.stack.log_clutter[row]))
            sizes.append(mode.effective_share * mode.num_samples)
            refined.append(mode)
            windows.append(mode.window)
        if not modes:
            origin.append(row)
            number.append(0)
            evidence.append(float(log_evidence[row]))
            sizes.append(float(effective[row]))
            refined.append(None)
            explained = float(log_evidence[row] - expanded.stack.log_clutter[row])
            windows.append(_carried(expanded, row, explained, weights.max_history))
    columns = {
        "numbers": np.array(number, dtype=int),
        "log_evidence": np.array(evidence),
        "effective_sample_sizes": np.array(sizes),
        "posterior_modes": _objects(refined),
        "windows": _objects(windows),
    }
    return np.array(origin, dtype=int), columns


def _objects(values: Sequence[object]) -> NDArray[np.object_]:
    """(M,) array of objects: a column of a table."""
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def _at_posterior_modes(expanded: UnsplitCandidates, origin: Index, rows: Assignments) -> WeighedAssociations:
    """The candidates, one row per mode, with problem and mode moved to the modes that were found."""
    problem, mode = expanded.stack.select(origin), expanded.mode.take(origin)
    assert rows.posterior_modes is not None
    moved = np.array(
        [row for row, posterior_mode in enumerate(rows.posterior_modes) if posterior_mode is not None], dtype=int
    )
    if len(moved):
        part = problem.select(moved)
        states = [expanded.states_of(int(origin[row]), rows.posterior_modes[row]) for row in moved]
        mode.y[moved] = part.coordinates(np.array(states))
        mode.hessian[moved] = part.normal_equations(mode.y[moved])[2]
    return replace(expanded.candidates, assignments=rows, problem=problem, mode=mode)


def _carried(expanded: UnsplitCandidates, row: int, log_evidence: float, max_links: int) -> Window | None:
    """The extended window of a candidate that was not searched; None if its parent has none, or it gets too long."""
    parent = expanded.parents[expanded.stack.rows.parents[row]]
    if parent.window is None or len(parent.window.taken) + 1 >= max_links:
        return None
    new = expanded.new[expanded.stack.rows.parents[row]]
    carried: Window = parent.window.with_keyframe(expanded.taken(row), new, log_evidence)
    return carried
