"""Semantics with a learned latent space: features weigh continuations, and enter the graph with their descriptors."""

from typing import Self

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.laplace import Mode, find_modes
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.frames import camera_bearing
from semantic_slam.inference.semantics.descriptors.descriptor_joint import descriptor_problem
from semantic_slam.inference.semantics.descriptors.descriptor_posterior import Posterior, integrated
from semantic_slam.inference.semantics.descriptors.descriptor_problem import DescriptorProblem
from semantic_slam.inference.semantics.descriptors.descriptor_tables import UnorientedView, update_unoriented
from semantic_slam.inference.semantics.interface import ClassModels, SemanticEvidence, SemanticInput
from semantic_slam.inference.states.heading_mixture import HeadingMixture
from semantic_slam.inference.states.object_views import DescriptorRecord, ObjectViews, class_posterior, coverage_of
from semantic_slam.latent.model import DescriptorBelief, DescriptorModel
from semantic_slam.perception.uncertainty import mutual_information

MAX_ITERATIONS = 12
TOLERANCE = 0.01
"""Expected gain [nats] of a further step below which a mode is converged."""
SPREAD_RAD = 0.1
"""Standard deviation of the direction of view above which several modes are searched for."""
SPREADS = (-1.5, 1.5)
"""Starts of that search, in standard deviations."""
UNKNOWN_SHARE = 0.5
"""Standard deviation of a descriptor component, relative to its prior's, above which the encoder's guess is tried."""
UNKNOWN_RAD = 0.5
"""Standard deviation of an object's heading above which it counts as unknown."""
DRAWS = 16
"""Number of descriptor samples for the epistemic part of the class uncertainty."""


class DescriptorViews:
    """Evidence of features about the geometric modes, with robot, objects and descriptors jointly uncertain."""

    def __init__(self, observation: LatentObservation) -> None:
        self._observation = observation
        self._unseen: dict[int, HeadingMixture] = {}

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the configured latent space, which the kind of class models must have."""
        assert models.latent is not None
        return cls(models.latent)

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Evidence and records of K continuations; the views themselves enter as factors.

        Objects whose heading neither a map nor the graph gives have heading modes of their own until it is known.
        """
        count = len(given.stack.mean)
        log_weights = np.zeros(count)
        views: list[dict[int, ObjectViews]] = [{} for _ in range(count)]
        turned = self._turned(given)
        active = given.stack.active & ~turned
        rows = np.flatnonzero(active.any(axis=1))
        if len(rows):
            problem = descriptor_problem(given, self._observation, rows, active[rows])
            v, mode = best_mode(problem)
            after = integrated(problem, v, mode, posterior(problem, v, mode))
            log_weights[rows] = mode.log_evidence + after.log_factor
            self._record(given, rows, problem, after, views)
        if turned.any():
            self._add_turned(given, turned, log_weights, views)
        return SemanticEvidence.of(log_weights, views)

    def _turned(self, given: SemanticInput) -> NDArray[np.bool_]:
        """(K, n) whether the heading of a detection's object is unknown."""
        stack = given.stack
        sigmas = [stack.heading_sigma(number) for number in range(stack.active.shape[1])]
        broad = np.array(sigmas).reshape(-1, len(stack.active)).T > UNKNOWN_RAD
        return np.asarray(stack.active & broad)

    def _add_turned(
        self, given: SemanticInput, turned: NDArray[np.bool_], log_weights: Array, views: list[dict[int, ObjectViews]]
    ) -> None:
        stack = given.stack
        states, covariances, _ = stack.marginals(given.mode.y, given.mode.hessian)
        detections = [given.step.detections[i] for i in given.used]
        seen = []
        for number in range(turned.shape[1]):
            bearing = camera_bearing(
                stack.robots_of(states), stack.objects_of(states, number), detections[number].sensor
            )
            for row in np.flatnonzero(turned[:, number]):
                object_id = given.object_ids[stack.rows.objects[row, number]]
                before = given.parents[stack.rows.parents[row]].views.get(object_id)
                sigma = float(np.sqrt(covariances[row, 0, 2, 2] + detections[number].covariance[1, 1]))
                start = self._start(before, object_id)
                seen.append(
                    UnorientedView(
                        row=int(row),
                        object_id=object_id,
                        number=number,
                        before=before,
                        start=start,
                        bearing_rad=float(bearing[row]),
                        sigma_rad=sigma,
                    )
                )
        inside = given.step.in_coverage[given.used]
        found = update_unoriented(self._observation, given.step.index, detections, inside, seen)
        for view, (record, evidence) in zip(seen, found, strict=True):
            log_weights[view.row] += evidence
            views[view.row][view.object_id] = record

    def _start(self, before: ObjectViews | None, object_id: int) -> HeadingMixture:
        if before is not None and before.headings is not None:
            return before.headings.modes
        if object_id not in self._unseen:
            self._unseen[object_id] = HeadingMixture.all_around(self._observation.prior_of(object_id))
        return self._unseen[object_id]

    def _record(
        self,
        given: SemanticInput,
        rows: Index,
        problem: DescriptorProblem,
        after: Posterior,
        views: list[dict[int, ObjectViews]],
    ) -> None:
        batch, number = np.nonzero(problem.active)
        slots = problem.slots[batch, number]
        belief = DescriptorBelief(after.descriptors[batch, slots], np.sqrt(after.variances[batch, slots]))
        likelihood = self._observation.model.class_log_likelihood(belief)
        places = given.stack.rows.objects[rows[batch], number]
        epistemic = epistemic_parts(self._observation.model, belief, given.log_class_prior[places])
        bearings = _bearings(given)
        for at, (row, own) in enumerate(zip(batch, number, strict=True)):
            object_id = given.object_ids[places[at]]
            records = views[rows[row]]
            before = records.get(object_id)
            entering = before.descriptor.entering if before is not None and before.descriptor is not None else ()
            index = given.used[own]
            if before is None:
                before = given.parents[given.stack.rows.parents[rows[row]]].views.get(object_id)
            records[object_id] = ObjectViews(
                log_likelihood=likelihood[at],
                mutual_information=float(epistemic[at]),
                coverage=coverage_of(before).with_view(
                    float(bearings[own][rows[row]]), is_recognised=bool(given.step.in_coverage[index])
                ),
                descriptor=DescriptorRecord(
                    mean=belief.mean[at],
                    variance=belief.sigma[at] ** 2,
                    direction_sigma_rad=float(after.directions[row, own]),
                    entering=(*entering, (given.step.index, given.step.detections[index])),
                ),
            )


def _bearings(given: SemanticInput) -> list[Array]:
    """n of (K,) bearings [rad] in map from the object of a detection to the camera, at the modes."""
    stack, states = given.stack, given.stack.states(given.mode.y)
    sensors = [given.step.detections[index].sensor for index in given.used]
    robots = stack.robots_of(states)
    return [camera_bearing(robots, stack.objects_of(states, at), sensor) for at, sensor in enumerate(sensors)]


def best_mode(problem: DescriptorProblem) -> tuple[Array, Mode]:
    """The heaviest of the modes next to some starts: (B, V) and its curvature."""
    v, mode = _mode(problem, started(problem, np.zeros((len(problem.mean), problem.gain.shape[2]))))
    for start, rows in _more_starts(problem, v):
        other_v, other = _mode(problem.select(rows), start)
        better = other.log_evidence > mode.log_evidence[rows]
        chosen = rows[better]
        v[chosen], mode.hessian[chosen] = other_v[better], other.hessian[better]
        mode.log_evidence[chosen] = other.log_evidence[better]
    return v, mode


def _mode(problem: DescriptorProblem, start: Array) -> tuple[Array, Mode]:
    mode = find_modes(problem, start, MAX_ITERATIONS, TOLERANCE)
    return mode.y, mode


def started(problem: DescriptorProblem, v: Array) -> Array:
    """(B, V) ``v`` with the encoder's guess of the descriptors, where that explains the features better."""
    size = problem.num_tangent
    batch, count = problem.active.shape
    own = problem.gain[:, size:, size:]
    variance = (own.reshape(batch, count, -1, own.shape[2]) ** 2).sum(axis=-1)  # (B, n, L)
    open_slots = problem.active & (problem.slots == np.arange(count))
    open_slots &= (variance > (UNKNOWN_SHARE * problem.observation.prior.sigma) ** 2).any(axis=-1)
    if not open_slots.any():
        return v
    guess = problem.observation.model.encode(problem.seen.feature)
    share = variance / (variance + guess.sigma**2)
    step = np.where(open_slots[..., None], share * (guess.mean - problem.descriptors(v)), 0.0).reshape(batch, -1)
    encoded = v.copy()
    encoded[:, size:] += np.linalg.solve(own, step[..., None])[..., 0]
    costs = [problem.energies(each).sum(-1) + 0.5 * (each**2).sum(-1) for each in (v, encoded)]
    return np.where((costs[1] < costs[0])[:, None], encoded, v)


def _more_starts(problem: DescriptorProblem, v: Array) -> list[tuple[Array, Index]]:
    """Starts at other directions of view, for the rows in which these are uncertain."""
    starts = []
    gain = problem.azimuth_gain(np.zeros_like(v))
    sigma = np.linalg.norm(gain, axis=-1)
    for number in range(sigma.shape[1]):
        rows = np.flatnonzero((sigma[:, number] > SPREAD_RAD) & problem.active[:, number])
        if len(rows):
            along = gain[rows, number] / sigma[rows, number, None]
            starts += [(started(problem.select(rows), spread * along), rows) for spread in SPREADS]
    return starts


def posterior(problem: DescriptorProblem, v: Array, mode: Mode) -> Posterior:
    """Descriptors and directions by the Gaussian at the mode."""
    gain = problem.gain[:, problem.num_tangent :]
    spread = np.linalg.solve(mode.hessian, np.swapaxes(gain, 1, 2))
    variances = np.einsum("biv,bvi->bi", gain, spread)
    turn = problem.azimuth_gain(v)
    towards = np.linalg.solve(mode.hessian, np.swapaxes(turn, 1, 2))
    sigma = np.sqrt(np.maximum(np.einsum("bnv,bvn->bn", turn, towards), 0.0))
    descriptors = problem.descriptors(v)
    return Posterior(
        log_factor=np.zeros(len(v)),
        descriptors=descriptors,
        variances=variances.reshape(descriptors.shape),
        directions=sigma,
    )


def epistemic_parts(model: DescriptorModel, belief: DescriptorBelief, log_prior: Array) -> Array:
    """(B,) mutual information [nats] between class and descriptor, NaN without classes.

    It is what exact knowledge of the descriptor would still say of the class.
    """
    count, length = belief.mean.shape
    if not log_prior.shape[1]:
        return np.full(count, np.nan)
    normals = np.random.default_rng(DRAWS).standard_normal((DRAWS, length))
    drawn = belief.mean[:, None] + belief.sigma[:, None] * normals
    points = DescriptorBelief(drawn.reshape(-1, length), np.zeros((count * DRAWS, length)))
    likelihood = model.class_log_likelihood(points).reshape(count, DRAWS, -1)
    return np.asarray(mutual_information(class_posterior(log_prior[:, None], likelihood)))
