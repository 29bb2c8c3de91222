"""Continuations of hypotheses: which object each detection is, and which class that object has.

Associations are grown detection by detection with the geometric evidence of the detections so far, by one linear step
where that can be trusted, or else at its mode; classes after that with a bound of their semantic likelihood. What
falls ``gate`` nats behind the best of its parent is not grown further; the mass left out is estimated by assuming that
it would have continued as well as the best.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.partial_assignments import PartialAssignments
from semantic_slam.inference.association.screening import ScreenedAssignments, screen
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.candidates import Candidates
from semantic_slam.inference.evidence.keyframe_problem import (
    KeyframeProblem,
    PredictedBelief,
    search_start,
)
from semantic_slam.inference.evidence.laplace import (
    RANKING_ITERATIONS,
    RANKING_TOLERANCE,
    WEIGHING_TOLERANCE,
    Mode,
    find_modes,
)
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True, kw_only=True)
class EnumerationProblem:
    """What enumeration needs to know besides the parents' Gaussians; C classes, O objects, P parents."""

    spaces: Spaces
    model: ObservationModel
    detections: Sequence[Any]
    object_ids: Index  # (O,)
    known_classes: Index  # (P, O) class, -1 while carried lazily
    log_class_prior: Array  # (O, C)
    distinct: bool
    gate: float  # nats; inf enumerates everything
    max_candidates: int  # per parent
    path: tuple[Index, Index] | None = None  # (n,) objects and (n,) classes: grow this one continuation only
    admitted: NDArray[np.bool_] | None = None  # (P, D, O) pairs that are enumerated; None: all

    @cached_property
    def collected(self) -> Any:
        """The detections as arrays."""
        return self.model.collect(self.detections)

    def first(self, count: int) -> Any:
        """The first ``count`` detections as arrays."""
        return self.collected if count == len(self.detections) else self.collected.take(slice(count))


def enumerate_associations(setting: EnumerationProblem, predicted: PredictedBelief) -> Candidates:
    """All associations of the detections to the objects, as far as the gate admits."""
    num_parents = len(predicted.mean)
    left_out = np.full(num_parents, -np.inf)
    prefixes = PartialAssignments.of_robots(setting.spaces, predicted)
    mode = _of_prior(num_parents, setting.spaces.layout.robot)
    for number in range(len(setting.detections)):
        origin, objects = _next_objects(setting, prefixes.rows, predicted.mean.shape[1] - 1)
        screened = screen(prefixes, mode, origin, objects, setting.model, setting.first(number + 1), setting.gate)
        parents = screened.prefixes.rows.parents
        last = number == len(setting.detections) - 1
        if last and setting.model.num_classes == 0:
            mode = find_modes(screened.stack, screened.mode.y, tolerance=WEIGHING_TOLERANCE)
        else:
            mode = _ranking(screened)
        keep, dropped = _gated(parents, mode.log_evidence, setting.gate, num_parents, setting.max_candidates)
        left_out = np.logaddexp(left_out, np.logaddexp(screened.log_left_out, dropped))
        prefixes, mode = screened.prefixes.take(keep), mode.take(keep)
    return _associated(setting, prefixes.stack(setting.model, setting.collected), mode, left_out)


def _associated(setting: EnumerationProblem, problem: KeyframeProblem, mode: Mode, log_left_out: Array) -> Candidates:
    """Candidates whose classes, where there are any, are still open."""
    rows = problem.rows.gaining(log_evidence=mode.log_evidence, log_class_prior=np.zeros(len(mode.y)))
    return Candidates(
        assignments=rows,
        object_ids=setting.object_ids,
        log_left_out=log_left_out,
        problem=problem,
        start=mode.y,
        mode=mode,
    )


def _ranking(screened: ScreenedAssignments) -> Mode:
    """Modes that only rank: searched for where one linear step does not do."""
    rows, mode = screened.searched, screened.mode
    if len(rows):
        part = screened.stack.select(rows)
        refined = find_modes(part, mode.y[rows], RANKING_ITERATIONS, RANKING_TOLERANCE)
        mode.y[rows], mode.hessian[rows], mode.log_evidence[rows] = refined.y, refined.hessian, refined.log_evidence
    return mode


def fixed_association(setting: EnumerationProblem, predicted: PredictedBelief, objects: Index) -> Candidates:
    """One association (D,), as given with the detections, for every parent."""
    parents = np.arange(len(predicted.mean))
    rows = Assignments(parents=parents, objects=np.broadcast_to(objects, (len(parents), len(objects))))
    problem = KeyframeProblem.of(setting.spaces, setting.model, predicted, setting.collected, rows)
    mode = find_modes(problem, search_start(problem))
    return _associated(setting, problem, mode, np.full(len(parents), -np.inf))


def enumerate_classes(setting: EnumerationProblem, associated: Candidates) -> Candidates:
    """Every class for the objects a hypothesis had not observed, the known one for the others."""
    stack, mode = associated.solved()
    bounds, turns = _semantic_profiles(setting, stack, mode.y)  # (B, D, C) each
    num_parents, left_out = len(setting.known_classes), associated.log_left_out
    index, score, prior = np.arange(len(mode.y)), mode.log_evidence, np.zeros(len(mode.y))
    chosen = np.zeros((len(index), 0), dtype=int)
    for number in range(len(setting.detections)):
        options = _class_options(setting, stack, index, chosen, number)  # (B, C) log prior, -inf where excluded
        new = _is_new(setting, stack, index, number)
        row, cls = np.nonzero(np.isfinite(options))
        score = score[row] + np.where(stack.active[index[row], number], bounds[index[row], number, cls], 0.0)
        added = np.where(new[row], options[row, cls], 0.0)
        score, prior = score + added, prior[row] + added
        chosen = np.concatenate([chosen[row], cls[:, None]], axis=1)
        index = index[row]
        parents = stack.rows.parents[index]
        keep, dropped = _gated(parents, score, setting.gate, num_parents, setting.max_candidates)
        left_out = np.logaddexp(left_out, dropped)
        index, score, prior, chosen = index[keep], score[keep], prior[keep], chosen[keep]
    classes = np.where(stack.active[index], chosen, -1)
    problem = stack.with_classes(index, classes)
    chosen_turns = turns[index[:, None], np.arange(classes.shape[1]), np.maximum(classes, 0)]
    return Candidates(
        assignments=problem.rows.gaining(log_class_prior=prior),
        object_ids=associated.object_ids,
        log_left_out=left_out,
        problem=problem,
        start=_turned(problem, mode.y[index], chosen_turns),
        num_new=associated.num_new,
    )


def _of_prior(count: int, size: int) -> Mode:
    """Modes of the robot's prior alone, before any detection."""
    return Mode(np.zeros((count, size)), np.broadcast_to(np.eye(size), (count, size, size)), np.zeros(count))


def _next_objects(setting: EnumerationProblem, rows: Assignments, num_objects: int) -> tuple[Index, Index]:
    """Every row with every object that its next detection may be of: the row each one came from, and the object."""
    number = rows.objects.shape[1]
    allowed = np.ones((len(rows.parents), num_objects), dtype=bool)
    if setting.admitted is not None:
        allowed = setting.admitted[rows.parents, number]
    if setting.path is not None:
        allowed[:, np.arange(num_objects) != setting.path[0][number]] = False
    if setting.distinct and number:
        np.put_along_axis(allowed, rows.objects, False, axis=1)
    origin, objects = np.nonzero(allowed)
    return origin, objects


def _gated(parents: Index, score: Array, gate: float, num_parents: int, limit: int) -> tuple[Index, Array]:
    """Rows to keep, and per parent the log of the rest relative to the parent's best."""
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
    """For each detection under each class (B, D, C): a bound on its semantic log density, and the turn that suits it.

    Geometry leaves an object's heading open, and the density over it may have several modes. The turn [rad] is that
    of the best one, the prior of the heading included. Of classes that an object cannot have nothing is asked.
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
    """(B, D, C) classes of each detection's object that neither its prior nor the hypothesis rules out."""
    objects = np.maximum(rows.objects, 0)
    known = setting.known_classes[rows.parents[:, None], objects][..., None]
    same = (known < 0) | (known == np.arange(setting.model.num_classes))
    return np.asarray(same & np.isfinite(setting.log_class_prior[objects]))


def _turned(stack: KeyframeProblem, y: Array, turns: Array) -> Array:
    """(B, n) whitened states with the objects of the detections turned by (B, D) angles."""
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
    known = np.where(objects >= 0, setting.known_classes[parents, objects], 0)  # clutter: one option, which is ignored
    slot = stack.slots[index, number]
    if number:
        repeated = slot < number
        known = np.where(
            repeated, np.take_along_axis(chosen, np.minimum(slot, number - 1)[:, None], axis=1)[:, 0], known
        )
    fixed = known >= 0
    options[fixed] = np.where(classes == known[fixed, None], 0.0, -np.inf)
    if setting.path is not None:
        options[:, classes != max(int(setting.path[1][number]), 0)] = -np.inf
    return np.asarray(options)


def _is_new(setting: EnumerationProblem, stack: KeyframeProblem, index: Index, number: int) -> NDArray[np.bool_]:
    """(B,) whether detection ``number`` is the first ever of an object whose class is still open."""
    objects, parents = stack.rows.objects[index, number], stack.rows.parents[index]
    first = stack.slots[index, number] == number
    return np.asarray(first & (objects >= 0) & (setting.known_classes[parents, objects] < 0))
