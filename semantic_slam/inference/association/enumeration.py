"""Enumeration of data associations (which object is each detection of?) and classes for all parents, with gating.

Associations are grown detection by detection and ranked by the geometric evidence of the detections so far: from one
linear (Kalman) step where that can be trusted, else at the mode. Classes are grown after that, ranked by a bound on
their semantic likelihood. A partial candidate that falls ``gate`` nats behind the best of its parent is dropped; the
mass left out is estimated by assuming that it would have continued as well as the best.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.rows import joined_rows
from semantic_slam.inference.association.partial_assignments import PartialAssignments
from semantic_slam.inference.association.placeholders import Placeholders
from semantic_slam.inference.association.screening import ScreenedAssignments, screen
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import (
    KeyframeProblem,
    PredictedBelief,
)
from semantic_slam.inference.evidence.laplace import (
    RANKING_ITERATIONS,
    RANKING_TOLERANCE,
    WEIGHING_TOLERANCE,
    Mode,
    find_modes,
)
from semantic_slam.inference.evidence.search_start import search_start
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.states.spaces import Spaces

MOST_BYTES = 2.0**27
"""Size of the largest matrices of the candidates that are enumerated at once."""
CLUTTER_GATE = 2.0 / 3.0
"""Fraction of the gate that applies to associations with clutter, of which every keyframe has some.

Of 15 nats 10 are left: what the outlier floor of a view's likelihood can make up for and what pruning tolerates.
"""


@dataclass(frozen=True, kw_only=True)
class EnumerationProblem:
    """Input of the enumeration besides the parents' predicted Gaussians; C classes, O objects, P parents."""

    spaces: Spaces
    model: ObservationModel
    detections: Sequence[Any]
    object_ids: Index  # (O,)
    known_classes: Index  # (P, O) class in each parent's history, -1 while it is not enumerated yet
    log_class_prior: Array  # (O, C)
    distinct: bool  # whether the detections of a frame are of different objects
    gate: float  # nats; inf enumerates everything
    max_candidates: int  # per parent
    path: tuple[Index, Index] | None = None  # (n,) objects and (n,) classes: grow this one continuation only
    admitted: NDArray[np.bool_] | None = None  # (P, D, O) pairs that are enumerated; None: all
    exclusive: Index | None = None  # (O,) column of each object's mutually exclusive partner, -1: none; None: no pairs
    placeholders: Placeholders | None = None  # order of those of unmapped objects; None: there are not several
    log_clutter: Array | None = None  # (D,) log density as clutter, -inf: it is of an object; None: all are of objects

    def first_clutter(self, count: int) -> Array | None:
        """Log clutter densities of the first ``count`` detections; None without clutter."""
        return None if self.log_clutter is None else self.log_clutter[:count]

    @cached_property
    def collected(self) -> Any:
        """The detections collected into arrays."""
        return self.model.collect(self.detections)

    def first(self, count: int) -> Any:
        """The first ``count`` detections collected into arrays."""
        return self.collected if count == len(self.detections) else self.collected.take(slice(count))


class NoAssociationError(SemanticSlamError):
    """No association of a keyframe's detections is possible."""


def enumerate_associations(setting: EnumerationProblem, predicted: PredictedBelief) -> WeighedAssociations:
    """Enumerate all associations of the detections to objects or clutter within the gate. Raises NoAssociationError.

    Parents are independent, and taken a few at a time where all of them together would take too much memory.
    """
    count, parts, left_out = len(predicted.mean), list[_Enumerated](), []
    starts = range(0, count, _parents_at_once(setting, predicted))
    for start in starts:
        some = slice(start, start + starts.step)
        found, log_left_out = _enumerated(setting, predicted, some)
        parts += [] if found is None else [found]
        left_out.append(log_left_out)
    if not parts:
        raise NoAssociationError("a detection of the keyframe can be of nothing")
    rows, mode = Assignments.joined([part.rows for part in parts]), joined_rows([part.mode for part in parts], ())
    mean, root = (np.concatenate([getattr(part, name) for part in parts]) for name in ("mean", "root"))
    problem = KeyframeProblem(setting.spaces, setting.model, setting.collected, rows, mean, root, setting.log_clutter)
    return _associated(setting, problem, mode, np.concatenate(left_out))


def _parents_at_once(setting: EnumerationProblem, predicted: PredictedBelief) -> int:
    """Number of parents whose candidates' matrices take at most :data:`MOST_BYTES`."""
    detections, options = len(setting.detections), predicted.mean.shape[1]
    prefixes = min(float(setting.max_candidates), float(options) ** max(detections - 1, 0))
    size = setting.spaces.layout.size(detections)
    return max(1, int(MOST_BYTES / (prefixes * options * 8.0 * size**2)))


@dataclass(frozen=True)
class _Enumerated:
    """B associations of some of the parents, with their approximate modes."""

    rows: Assignments
    mean: Array  # (B, 1 + n, s)
    root: Array  # (B, r + n l, r + n l)
    mode: Mode


def _enumerated(
    setting: EnumerationProblem, predicted: PredictedBelief, parents: slice
) -> tuple[_Enumerated | None, Array]:
    """The associations of a few ``parents``, detection by detection, and (P,) their log mass left out.

    None if a detection can be of nothing under any of them.
    """
    predicted = replace(predicted, mean=predicted.mean[parents], covariance=predicted.covariance[parents])
    admitted = None if setting.admitted is None else setting.admitted[parents]
    placeholders = None if setting.placeholders is None else setting.placeholders.of_parents(parents)
    setting, first = replace(setting, admitted=admitted, placeholders=placeholders), parents.start
    num_parents = len(predicted.mean)
    left_out = np.full(num_parents, -np.inf)
    prefixes = PartialAssignments.of_robots(setting.spaces, predicted)
    mode = _of_prior(num_parents, setting.spaces.layout.robot)
    for number in range(len(setting.detections)):
        origin, objects = _next_objects(setting, prefixes.rows, predicted.mean.shape[1] - 1)
        seen, log_clutter = setting.first(number + 1), setting.first_clutter(number + 1)
        screened = screen(prefixes, mode, origin, objects, setting.model, seen, setting.gate, log_clutter)
        of_parents = screened.prefixes.rows.parents
        if not len(of_parents):
            return None, left_out
        last = number == len(setting.detections) - 1
        if last and setting.model.num_classes == 0:
            mode = find_modes(screened.stack, screened.mode.y, tolerance=WEIGHING_TOLERANCE)
        else:
            mode = _ranking(screened)
        gate: Array | float = setting.gate
        if last and setting.log_clutter is not None:
            has_clutter = (screened.prefixes.rows.objects < 0).any(axis=1)
            gate = np.where(has_clutter, CLUTTER_GATE * setting.gate, setting.gate)
        keep, dropped = _gated(of_parents, mode.log_evidence, gate, num_parents, setting.max_candidates)
        left_out = np.logaddexp(left_out, np.logaddexp(screened.log_left_out, dropped))
        prefixes, mode = screened.prefixes.take(keep), mode.take(keep)
    rows = replace(prefixes.rows, parents=prefixes.rows.parents + first)
    return _Enumerated(rows, prefixes.mean, prefixes.root, mode), left_out


def _associated(
    setting: EnumerationProblem, problem: KeyframeProblem, mode: Mode, log_left_out: Array
) -> WeighedAssociations:
    """The candidates before classes are enumerated."""
    rows = problem.rows.gaining(log_evidence=mode.log_evidence, log_class_prior=np.zeros(len(mode.y)))
    return WeighedAssociations(
        assignments=rows,
        object_ids=setting.object_ids,
        log_left_out=log_left_out,
        problem=problem,
        start=mode.y,
        mode=mode,
    )


def _ranking(screened: ScreenedAssignments) -> Mode:
    """Approximate modes, only for ranking: by search where one linear step is not accurate enough."""
    rows, mode = screened.searched, screened.mode
    if len(rows):
        part = screened.stack.select(rows)
        refined = find_modes(part, mode.y[rows], RANKING_ITERATIONS, RANKING_TOLERANCE)
        mode.y[rows], mode.hessian[rows], mode.log_evidence[rows] = refined.y, refined.hessian, refined.log_evidence
    return mode


def fixed_association(setting: EnumerationProblem, predicted: PredictedBelief, objects: Index) -> WeighedAssociations:
    """The single candidate of each parent with a given association ``objects`` (D,), columns of objects."""
    parents = np.arange(len(predicted.mean))
    rows = Assignments(parents=parents, objects=np.broadcast_to(objects, (len(parents), len(objects))))
    problem = KeyframeProblem.of(setting.spaces, setting.model, predicted, setting.collected, rows)
    mode = find_modes(problem, search_start(problem))
    return _associated(setting, problem, mode, np.full(len(parents), -np.inf))


def enumerate_classes(
    setting: EnumerationProblem, associated: WeighedAssociations, log_outlier: Array | None = None
) -> WeighedAssociations:
    """Expand candidates by classes: every class for objects without one in the history, the known one for the others.

    ``log_outlier`` (D,): log density of each view as an outlier, its probability included; None: there are no outliers.
    A first view that is an outlier leaves the object's class open (-1), as one candidate; the candidates of the classes
    then count inlier views only, see ``first_views``. Where the class is known, the likelihood contains both.
    """
    stack, mode = associated.solved()
    bounds, turns = _semantic_profiles(setting, stack, mode.y)  # (B, D, C) each
    open_class = setting.model.num_classes if log_outlier is not None else None  # the column of the outlier
    num_parents, left_out = len(setting.known_classes), associated.log_left_out
    index, score, prior = np.arange(len(mode.y)), mode.log_evidence, np.zeros(len(mode.y))
    chosen = np.zeros((len(index), 0), dtype=int)
    for number in range(len(setting.detections)):
        options = _class_options(setting, stack, index, chosen, number)  # (B, C) log prior, -inf where excluded
        new = is_new(setting, stack, index, chosen, number)
        bound = bounds[index, number]
        if log_outlier is not None:
            bound, options = _with_outlier(setting, bound, options, new, float(log_outlier[number]), number)
        row, cls = np.nonzero(np.isfinite(options))
        score = score[row] + np.where(stack.active[index[row], number], bound[row, cls], 0.0)
        added = np.where(new[row], options[row, cls], 0.0)
        score, prior = score + added, prior[row] + added
        chosen = np.concatenate([chosen[row], np.where(cls == open_class, -1, cls)[:, None]], axis=1)
        index = index[row]
        parents = stack.rows.parents[index]
        keep, dropped = _gated(parents, score, setting.gate, num_parents, setting.max_candidates)
        left_out = np.logaddexp(left_out, dropped)
        index, score, prior, chosen = index[keep], score[keep], prior[keep], chosen[keep]
    classes = np.where(stack.active[index], chosen, -1)
    problem = stack.with_classes(index, classes)
    chosen_turns = turns[index[:, None], np.arange(classes.shape[1]), np.maximum(classes, 0)]
    return WeighedAssociations(
        assignments=problem.rows.gaining(log_class_prior=prior),
        object_ids=associated.object_ids,
        log_left_out=left_out,
        problem=problem,
        start=_turned(problem, mode.y[index], chosen_turns),
        num_new=associated.num_new,
    )


def _of_prior(count: int, size: int) -> Mode:
    """Modes of the robot's prior alone, before any detection: zero in whitened coordinates."""
    return Mode(np.zeros((count, size)), np.broadcast_to(np.eye(size), (count, size, size)), np.zeros(count))


def _next_objects(setting: EnumerationProblem, rows: Assignments, num_objects: int) -> tuple[Index, Index]:
    """Extend every row by each object that its next detection may be of: the originating rows, and the objects.

    Clutter is -1, and comes after all objects.
    """
    number = rows.objects.shape[1]
    allowed = np.ones((len(rows.parents), num_objects + 1), dtype=bool)
    if setting.admitted is not None:
        allowed[:, :-1] = setting.admitted[rows.parents, number]
    if setting.placeholders is not None:
        allowed[:, :-1] &= setting.placeholders.admitted(rows)
    if setting.distinct and number:
        np.put_along_axis(allowed, rows.objects, False, axis=1)
    if setting.exclusive is not None and number:
        np.put_along_axis(allowed, np.append(setting.exclusive, -1)[rows.objects], False, axis=1)
    allowed[:, -1] = setting.log_clutter is not None and np.isfinite(setting.log_clutter[number])
    if setting.path is not None:
        allowed[:, np.append(np.arange(num_objects), -1) != setting.path[0][number]] = False
    origin, objects = np.nonzero(allowed)
    return origin, np.where(objects == num_objects, -1, objects)


def _gated(parents: Index, score: Array, gate: Array | float, num_parents: int, limit: int) -> tuple[Index, Array]:
    """Rows within the gate and limit of their parents, and (P,) the log mass of the rest relative to the best."""
    best = np.full(num_parents, -np.inf)
    np.maximum.at(best, parents, score)
    behind = score - best[parents]
    keep = behind >= -gate
    order = np.lexsort((np.arange(len(score)), -score, parents))
    rank = np.empty(len(score), dtype=int)
    rank[order] = np.arange(len(score)) - np.searchsorted(parents[order], parents[order])
    keep &= rank < limit
    left_out = np.full(num_parents, -np.inf)
    np.logaddexp.at(left_out, parents[~keep], behind[~keep])
    return np.flatnonzero(keep), left_out


def _semantic_profiles(setting: EnumerationProblem, stack: KeyframeProblem, y: Array) -> tuple[Array, Array]:
    """(B, D, C) upper bounds on each detection's semantic log density under each class, and the best heading changes.

    Geometry leaves an object's heading open, and the semantic density over it may have several modes. The heading
    change [rad] leads to the best one, its prior included. Classes that an object cannot have get -inf and 0.
    """
    states, possible = stack.states(y), _possible_classes(setting, stack.rows)
    bounds, turns = np.full(possible.shape, -np.inf), np.zeros(possible.shape)
    for number in range(len(setting.detections)):
        row, cls = np.nonzero(possible[:, number])
        sigma, objects = stack.heading_sigma(number)[row], stack.objects_of(states, number)
        bounds[row, number, cls], turns[row, number, cls] = setting.model.best_heading(
            stack.detections.take([number]), stack.robots_of(states)[row], objects[row], cls, sigma
        )
    return bounds, turns


def _possible_classes(setting: EnumerationProblem, rows: Assignments) -> NDArray[np.bool_]:
    """(B, D, C) classes of each detection's object that neither its prior nor the history rules out."""
    objects = np.maximum(rows.objects, 0)
    known = setting.known_classes[rows.parents[:, None], objects][..., None]
    same = (known < 0) | (known == np.arange(setting.model.num_classes))
    return np.asarray(same & np.isfinite(setting.log_class_prior[objects]))


def _turned(stack: KeyframeProblem, y: Array, turns: Array) -> Array:
    """(B, n) whitened states with the headings of the detections' objects changed by (B, D) angles."""
    tangent = np.zeros((len(y), stack.size))
    for number in range(turns.shape[1]):
        heading = stack.heading_rows(number)
        if heading is None:
            return y
        is_first = stack.active[:, number] & (stack.slots[:, number] == number)
        tangent[np.arange(len(y)), heading] += np.where(is_first, turns[:, number], 0.0)
    return np.asarray(y + np.linalg.solve(stack.root, tangent[..., None])[..., 0])


def _class_options(
    setting: EnumerationProblem, stack: KeyframeProblem, index: Index, chosen: Index, number: int
) -> Array:
    """(B, C) log prior of the classes that detection ``number``'s object may have, -inf for the others."""
    objects, parents = stack.rows.objects[index, number], stack.rows.parents[index]
    classes = np.arange(setting.model.num_classes)
    options = setting.log_class_prior[np.maximum(objects, 0)].copy()
    known = np.where(objects >= 0, setting.known_classes[parents, objects], 0)  # clutter: one dummy class, ignored
    known = np.maximum(known, _chosen_before(stack, index, chosen, number))
    fixed = known >= 0
    options[fixed] = np.where(classes == known[fixed, None], 0.0, -np.inf)
    if setting.path is not None:
        options[:, classes != max(int(setting.path[1][number]), 0)] = -np.inf
    return np.asarray(options)


def _with_outlier(
    setting: EnumerationProblem, bound: Array, options: Array, new: NDArray[np.bool_], log_outlier: float, number: int
) -> tuple[Array, Array]:
    """(B, C + 1) bounds and log priors with the open class (outlier) last, for objects (B,) ``new`` without a class."""
    bound = np.where(new[:, None], log_of_inlier(bound, log_outlier), bound)
    options = np.where(new[:, None] & ~np.isfinite(bound), -np.inf, options)
    stays_open = new
    if setting.path is not None:
        stays_open = new & (setting.path[1][number] < 0)
        options = np.where(stays_open[:, None], -np.inf, options)
    column = np.where(stays_open, 0.0, -np.inf)[:, None]
    bound = np.concatenate([bound, np.full((len(bound), 1), log_outlier)], axis=1)
    return bound, np.concatenate([options, column], axis=1)


def log_of_inlier(log_mixed: Array, log_outlier: float) -> Array:
    """Log of the inlier part (1 - e) p, from the logs of (1 - e) p + e p_out and of e p_out."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(log_mixed + np.log(-np.expm1(np.minimum(log_outlier - log_mixed, 0.0))))


def is_new(
    setting: EnumerationProblem, stack: KeyframeProblem, index: Index, chosen: Index, number: int
) -> NDArray[np.bool_]:
    """(B,) whether detection ``number`` is of an object whose class is still open.

    Neither the history nor the (B, number) classes ``chosen`` for earlier detections of the frame fix it.
    """
    objects, parents = stack.rows.objects[index, number], stack.rows.parents[index]
    known = np.maximum(setting.known_classes[parents, objects], _chosen_before(stack, index, chosen, number))
    return np.asarray((objects >= 0) & (known < 0))


def _chosen_before(stack: KeyframeProblem, index: Index, chosen: Index, number: int) -> Index:
    """(B,) class ``chosen`` for the object of detection ``number`` by an earlier detection of the frame; -1: none."""
    same = stack.slots[index, :number] == stack.slots[index, number][:, None]
    return np.asarray(np.where(same, chosen, -1).max(axis=1, initial=-1))
