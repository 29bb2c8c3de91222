"""Continuations where the number of objects is unknown: a Poisson multi-Bernoulli mixture over SLAM hypotheses.

A detection is of an object that its hypothesis knows, or of none: then a new object starts, whose existence weighs
objects not detected so far against false alarms. Objects that should have been detected and were not lose existence,
and their hypothesis weight, by the same probabilities.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry import se2
from semantic_slam.inference.births import Birth, birth_of
from semantic_slam.inference.component import Component, LostComponentError, Observed
from semantic_slam.inference.continuation import Continuations
from semantic_slam.inference.enumeration import Enumerated, Setting, enumerate_classes
from semantic_slam.inference.existence import SensorRegion, birth, missed
from semantic_slam.inference.gating import Chosen, best_assignments, pair_densities
from semantic_slam.inference.gaussian import GaussianPrior
from semantic_slam.inference.identity import hypothesis_id
from semantic_slam.inference.laplace import Mode, find_modes, search_start
from semantic_slam.inference.objects import ObjectRegistry
from semantic_slam.inference.open_component import Grown, OpenComponent
from semantic_slam.inference.population import Population
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.protocol import LineageStep
from semantic_slam.inference.semantics import Moment, Weighed
from semantic_slam.inference.sightlines import Prediction, detection_probabilities, undetected_share
from semantic_slam.inference.stack import Predicted, Rows, Stack
from semantic_slam.inference.step import Step

Array = NDArray[np.float64]
Index = NDArray[np.int_]

LEAST_DETECTION_SHARE = 0.02
"""Of the detection probability, for objects that were detected although they seem to lie outside the region."""
FIXED_HEADING_VARIANCE = 1e-8
LOST_SIGMA_M = 0.5
"""Robot's standard deviation from which on a search for the mode also starts where single detections put the robot."""


@dataclass(frozen=True)
class Outlook:
    """One parent before the detections: M objects near them, and what may be missed."""

    component: OpenComponent
    near: Index  # (M,) ids whose covariance with the robot is known
    predicted: Predicted  # of one parent: robot and near objects
    births: dict[int, Birth]  # id -> object that the detection of that number would start
    log_intensity: Array  # (D,) [1/m^2] or, for a bearing alone, objects and false alarms in a frame
    birth_existence: Array  # (D,)
    in_reach: Index  # (N,) rows of the population that may be in the region
    prediction: Prediction  # of those


@dataclass(frozen=True)
class OpenContinuations(Continuations):
    """Besides: for each continuation what it makes of the objects' existence."""

    existence: list[dict[int, float]] = field(default_factory=list)  # K: id -> r of all objects kept


class OpenExpander:
    """Weighs continuations in an open world; a pure function of the problem, the registry and what it is given."""

    def __init__(self, problem: Problem, registry: ObjectRegistry):
        self.problem, self.registry, self.settings = problem, registry, problem.open_world
        settings = self.settings
        self.region = sensor_region(settings)
        self._clutter = settings.clutter_per_frame / self.region.area_m2

    def expand(
        self, step: Step, parent_ids: Sequence[int], components: Sequence[Component], path: LineageStep | None = None
    ) -> OpenContinuations:
        """Continuations of every parent, or of one along ``path`` alone. Raises LostComponentError."""
        outlooks = [self._outlook(step, component) for component in components]
        born = self._born(step)
        known = sorted({int(n) for outlook in outlooks for n in outlook.near})
        predicted = _padded(outlooks, known, born)
        if self.problem.model.num_classes == 0:
            predicted = _without_headings(predicted)
        rows, scores, left_out = self._associations(step, outlooks, known, path)
        setting = self._setting(step, [*known, *born], components, path)
        stack = Stack(setting.manifold, setting.model, predicted, setting.detections, rows)
        mode = find_modes(stack, self._start(stack, outlooks))
        enumerated = Enumerated(rows, mode.y, mode.log_evidence, np.zeros(len(scores)), left_out)
        if setting.model.num_classes > 0 and len(step.detections):
            enumerated = enumerate_classes(setting, predicted, enumerated)
            stack = Stack(setting.manifold, setting.model, predicted, setting.detections, enumerated.rows)
            mode = find_modes(stack, enumerated.start)
        used = np.arange(len(step.detections))
        births = [{n: birth.prior for n, birth in outlook.births.items()} for outlook in outlooks]
        prior = setting.log_class_prior
        moment = Moment(step, components, stack, mode, used, [*known, *born], prior, births)
        return self._weighed(moment, parent_ids, enumerated, outlooks)

    def grown(
        self, component: Component, step: Step, found: OpenContinuations, at: int, *, in_place: bool
    ) -> OpenComponent:
        """The component of one continuation. Raises LostComponentError."""
        assert isinstance(component, OpenComponent)
        taken = found.steps[at]
        pairs = zip(step.detections, taken.association, taken.class_assignment, strict=True)
        observed = [Observed(detection, number, cls) for detection, number, cls in pairs]
        births, modes = found.new_objects[found.parents[at]], found.objects[at]
        new = {
            n: GaussianPrior(mode, births[n].covariance)
            for n, mode in zip(taken.association, modes, strict=True)
            if n in births
        }
        added = Grown(
            observed,
            list(modes),
            found.robot[at],
            new,
            found.views[at],
            found.robot_corrections[at],
            found.existence[at],
        )
        return component.grown(step, added, self.settings.max_joint_objects, in_place=in_place)

    def _born(self, step: Step) -> list[int]:
        """Ids of the objects that the detections would start: a function of the keyframes so far."""
        first = self.registry.first_new_id(step.index)
        return list(range(first, first + len(step.detections)))

    def _outlook(self, step: Step, component: Component) -> Outlook:
        assert isinstance(component, OpenComponent)
        population, manifold = component.objects, self.problem.manifold
        before = component.newest_robot()
        robot = manifold.compose(before, step.motion.control)
        transition = manifold.propagation(step.motion.control)
        spread = transition @ population.robot_covariance @ transition.T + step.motion.covariance
        field_of_view = self.region.field_of_view_rad
        starts = [birth_of(self.problem.model, detection, robot, field_of_view) for detection in step.detections]
        chosen = self._near(population, robot, spread, starts, step.detections)
        near = population.ids[chosen]
        predicted = component.predict(step.motion, near.tolist())
        intensity, existence = self._births(population, starts, step.detections)
        reach = np.flatnonzero(_distances(population.states, robot) < self._reach(spread))
        return Outlook(
            component,
            near,
            predicted,
            dict(zip(self._born(step), starts, strict=True)),
            intensity,
            existence,
            reach,
            _prediction(population, reach, chosen, predicted),
        )

    def _reach(self, spread: Array) -> float:
        return self.region.max_range_m + self.settings.gate_sigma * _position_sigma(spread)

    def _near(
        self, population: Population, robot: Array, spread: Array, starts: list[Birth], detections: Sequence[Any]
    ) -> Index:
        """(M,) rows of objects that a detection may be of; where objects are few, of all within reach.

        The bound on the distance takes the errors of robot and object as fully correlated, whichever way is worst.
        """
        limit, sigmas = self.settings.max_joint_objects, self.settings.gate_sigma
        distance = _distances(population.states, robot)
        within = distance < self._reach(spread)
        if within.sum() <= limit and len(population.ids) <= limit:
            return np.flatnonzero(within)
        own = np.sqrt(np.maximum(np.linalg.eigvalsh(population.covariances[:, :2, :2])[:, -1], 0.0))
        excess = np.full(len(population.ids), np.inf)
        for start, detection in zip(starts, detections, strict=True):
            if not detection.has_range:
                excess = np.where(within, np.minimum(excess, 0.0), excess)
                continue
            point = start.prior.mean
            swing = float(np.sqrt(spread[2, 2])) * _distances(point[None], robot)[0]
            noise = float(np.sqrt(np.trace(detection.covariance * np.diag([1.0, detection.range_m**2]))))
            bound = sigmas * (_position_sigma(spread) + own + swing + noise)
            excess = np.minimum(excess, _distances(population.states, point) / bound)
        order = np.argsort(excess, kind="stable")[:limit]
        return np.asarray(np.sort(order[excess[order] < 1.0]))

    def _births(
        self, population: Population, starts: list[Birth], detections: Sequence[Any]
    ) -> tuple[Array, Array]:
        """(D,) log intensities of first detections and (D,) existence of what they are detections of."""
        points = np.array([start.prior.mean[:2] for start in starts]).reshape(-1, 2)
        share = np.maximum(
            undetected_share(self.region, population.trail, points), self.settings.least_undetected_share
        )
        density = self.settings.birth_density * share
        intensity, existence = birth(density, self._clutter, self.region.detection_probability)
        ranged = np.array([detection.has_range for detection in detections], dtype=bool)
        return np.log(np.where(ranged, intensity, intensity * self.region.area_m2)), existence

    def _associations(
        self, step: Step, outlooks: list[Outlook], known: list[int], path: LineageStep | None
    ) -> tuple[Rows, Array, Array]:
        """Rows over the columns [known, born] of all parents, their scores, and what was left out of each parent."""
        parents, objects, scores, left_out = [], [], [], []
        place = {number: column for column, number in enumerate([*known, *self._born(step)])}
        for parent, outlook in enumerate(outlooks):
            columns = np.array([place[int(n)] for n in outlook.near] + [place[n] for n in outlook.births], dtype=int)
            if path is not None:
                own = np.array([[place.get(n, -1) for n in path.association]], dtype=int).reshape(1, -1)
                if (own < 0).any():
                    raise LostComponentError("a lineage names an object that its hypothesis does not know")
                chosen = Chosen(own, np.zeros(1), -np.inf)
            else:
                chosen = self._assignments(step, outlook)
                own = columns[chosen.columns]
            parents.append(np.full(len(own), parent))
            objects.append(own)
            scores.append(chosen.log_scores)
            left_out.append(chosen.log_left_out)
        return Rows(np.concatenate(parents), np.concatenate(objects)), np.concatenate(scores), np.array(left_out)

    def _assignments(self, step: Step, outlook: Outlook) -> Chosen:
        mean, covariance = outlook.predicted.mean[0], outlook.predicted.covariance[0]
        pairs = pair_densities(self.problem.model, step.detections, mean, covariance, self.problem.manifold.dimension)
        population = outlook.component.objects
        r = population.existence[population.rows(outlook.near)]
        detected = self._detected_at_prediction(outlook)
        with np.errstate(divide="ignore"):
            log_ratio = np.log(r * np.maximum(detected, self._least_detected)) - missed(r, detected)[0]
        log_new = outlook.log_intensity + np.array([birth.log_area for birth in outlook.births.values()])
        return best_assignments(
            pairs.log_density + log_ratio,
            pairs.distance < self.settings.gate_sigma,
            log_new,
            self.problem.weights.max_candidates,
            self.problem.weights.gate,
        )

    @property
    def _least_detected(self) -> float:
        return LEAST_DETECTION_SHARE * self.region.detection_probability

    def _detected_at_prediction(self, outlook: Outlook) -> Array:
        """(M,) detection probabilities of the near objects before anything is known of the detections."""
        population = outlook.component.objects
        detected = np.zeros(len(population.ids))
        nothing = (np.zeros(0), np.zeros(0))
        robot, spread = outlook.prediction.robot[None], outlook.prediction.robot_covariance[None]
        detected[outlook.in_reach] = detection_probabilities(
            self.region, outlook.prediction, robot, spread, nothing
        )[0]
        return detected[population.rows(outlook.near)]

    def _start(self, stack: Stack, outlooks: list[Outlook]) -> Array:
        """The prediction, or where single detections put a robot that may be elsewhere."""
        start = np.zeros((len(stack.mean), stack.size))
        sigma = max(_position_sigma(outlook.prediction.robot_covariance) for outlook in outlooks)
        return search_start(stack) if sigma > LOST_SIGMA_M else start

    def _setting(
        self, step: Step, object_ids: list[int], components: Sequence[Component], path: LineageStep | None
    ) -> Setting:
        known = [[component.classes.get(n, -1) for n in object_ids] for component in components]
        limit = np.inf if path is not None else self.problem.weights.gate
        chosen = None
        if path is not None:
            objects = np.array([object_ids.index(n) for n in path.association], dtype=int)
            chosen = (objects, np.array(path.class_assignment, dtype=int))
        return Setting(
            self.problem.manifold,
            self.problem.model,
            step.detections,
            np.array(known, dtype=int).reshape(len(components), len(object_ids)),
            self.registry.log_class_prior_of(object_ids),
            True,
            limit,
            self.problem.weights.max_candidates,
            chosen,
        )

    def _weighed(
        self, moment: Moment, parent_ids: Sequence[int], enumerated: Enumerated, outlooks: list[Outlook]
    ) -> OpenContinuations:
        rows, step, stack, mode = enumerated.rows, moment.step, moment.stack, moment.mode
        steps = _lineage_steps(rows, moment.object_ids)
        ids = [
            hypothesis_id(parent_ids[p], step.stamp_ns, s.association, s.class_assignment, s.mode)
            for p, s in zip(rows.parents, steps, strict=True)
        ]
        states, covariances = _marginals(stack, mode)
        weighed = self._semantics(moment)
        factors, existence = self._existence(step, steps, rows.parents, outlooks, states[:, 0], covariances[:, 0])
        log_psi = mode.log_evidence + enumerated.log_class_prior + weighed.log_weights + factors
        best = np.full(len(parent_ids), -np.inf)
        np.maximum.at(best, rows.parents, log_psi)
        at = np.arange(len(states))[:, None]
        return OpenContinuations(
            ids=ids,
            parents=rows.parents,
            steps=steps,
            log_psi=log_psi,
            effective_sample_sizes=weighed.effective_sample_sizes,
            robot=states[:, 0],
            robot_covariance=covariances[:, 0],
            objects=states[at, 1 + stack.slots],
            object_covariances=covariances[at, 1 + stack.slots],
            used=moment.used,
            log_left_out=enumerated.log_left_out + best,
            new_objects=list(moment.new),
            views=weighed.views,
            robot_corrections=weighed.robot,
            existence=existence,
        )

    def _semantics(self, moment: Moment) -> Weighed:
        count = len(moment.stack.mean)
        if self.problem.semantics is None or not len(moment.used):
            return Weighed(np.zeros(count), np.full(count, np.nan), [{} for _ in range(count)], [None] * count)
        return self.problem.semantics.weigh(moment)

    def _existence(
        self,
        step: Step,
        steps: list[LineageStep],
        parents: Index,
        outlooks: list[Outlook],
        robot: Array,
        covariance: Array,
    ) -> tuple[Array, list[dict[int, float]]]:
        """(K,) log factors of births, detections and misses, and each continuation's existence of its objects."""
        expected = self.settings.clutter_per_frame
        expected += self.region.detection_probability * self.settings.birth_density * self.region.area_m2
        factors, existence = np.full(len(steps), -expected), [dict[int, float]() for _ in steps]
        seen = _ranges_and_bearings(step)
        for parent, outlook in enumerate(outlooks):
            rows = np.flatnonzero(parents == parent)
            detected = detection_probabilities(self.region, outlook.prediction, robot[rows], covariance[rows], seen)
            for at, row in enumerate(rows):
                added, existence[row] = self._account(outlook, steps[row].association, detected[at])
                factors[row] += added
        return factors, existence

    def _account(
        self, outlook: Outlook, association: tuple[int, ...], detected: Array
    ) -> tuple[float, dict[int, float]]:
        """Log factor and existence of one continuation; ``detected`` (N,) probabilities of the objects in reach."""
        population = outlook.component.objects
        r, chances = population.existence.copy(), np.zeros(len(population.ids))
        chances[outlook.in_reach] = detected
        observed = np.isin(population.ids, association)
        log_factor, after = missed(r, chances)
        total = float(log_factor[~observed].sum())
        with np.errstate(divide="ignore"):
            total += float(np.log(r * np.maximum(chances, self._least_detected))[observed].sum())
        r = np.where(observed, 1.0, after)
        kept = observed | (r >= self.settings.least_existence)
        existence = dict(zip(population.ids[kept].tolist(), r[kept].tolist(), strict=True))
        for number, object_id in enumerate(association):
            if object_id in outlook.births:
                existence[object_id] = float(outlook.birth_existence[number])
                total += float(outlook.log_intensity[number]) + outlook.births[object_id].log_scale
        return total, existence


def sensor_region(settings: OpenWorldConfiguration) -> SensorRegion:
    """The region in which a miss counts."""
    return SensorRegion(
        settings.detection_probability,
        settings.min_range_m,
        settings.max_range_m,
        settings.field_of_view_rad,
        settings.occluder_radius_m,
    )


def _padded(outlooks: list[Outlook], known: list[int], born: list[int]) -> Predicted:
    """Predicted Gaussians of all parents over the same columns; those a parent does not know are never referred to."""
    dimension = outlooks[0].predicted.mean.shape[-1]
    columns = 1 + len(known) + len(born)
    mean = np.zeros((len(outlooks), columns, dimension))
    covariance = np.tile(np.eye(columns * dimension), (len(outlooks), 1, 1))
    for parent, outlook in enumerate(outlooks):
        known_columns = 1 + np.searchsorted(known, outlook.near)
        own = np.concatenate([[0], known_columns, 1 + len(known) + np.arange(len(born))]).astype(int)
        places = (own[:, None] * dimension + np.arange(dimension)).ravel()
        states, spread = _with_births(outlook.predicted, list(outlook.births.values()))
        mean[parent, own] = states
        covariance[parent, places[:, None], places] = spread
    return Predicted(mean, covariance)


def _with_births(predicted: Predicted, births: list[Birth]) -> tuple[Array, Array]:
    """States (1 + M + D, d) and their covariance: robot, near objects, and the objects that D detections start."""
    before, dimension = predicted.covariance[0], predicted.mean.shape[-1]
    size = len(before)
    if not births:
        return predicted.mean[0], before
    gains = np.concatenate([birth.gain for birth in births])
    cross = gains @ before[:dimension]
    spread = np.block([[before, cross.T], [cross, gains @ before[:dimension, :dimension] @ gains.T]])
    for number, birth in enumerate(births):
        block = slice(size + number * dimension, size + (number + 1) * dimension)
        spread[block, block] += birth.spread
    return np.concatenate([predicted.mean[0], np.array([birth.prior.mean for birth in births])]), spread


def _without_headings(predicted: Predicted) -> Predicted:
    """The same with objects that do not turn: no measurement depends on it, and a wide angle bends their positions."""
    size, dimension = predicted.covariance.shape[-1], predicted.mean.shape[-1]
    headings = np.arange(2 * dimension - 1, size, dimension)
    covariance = predicted.covariance.copy()
    covariance[:, headings], covariance[:, :, headings] = 0.0, 0.0
    covariance[:, headings, headings] = FIXED_HEADING_VARIANCE
    return Predicted(predicted.mean, covariance)


def _prediction(population: Population, reach: Index, chosen: Index, predicted: Predicted) -> Prediction:
    """Objects in reach given the robot. Those whose covariance with it is not at hand count as moving along with it."""
    dimension = predicted.mean.shape[-1]
    robot, spread = predicted.mean[0, 0], predicted.covariance[0, :dimension, :dimension]
    states = population.states[reach]
    gain = _moving_along(robot, states)
    remainder = np.zeros((len(reach), dimension, dimension))
    blocks = predicted.covariance[0].reshape(1 + len(chosen), dimension, 1 + len(chosen), dimension)
    for at in np.flatnonzero(np.isin(reach, chosen)):
        number = 1 + int(np.searchsorted(chosen, reach[at]))
        gain[at] = np.linalg.solve(spread, blocks[0, :, number]).T
        remainder[at] = blocks[number, :, number] - gain[at] @ blocks[0, :, number]
    return Prediction(robot, spread, states, gain, remainder)


def _moving_along(robot: Array, states: Array) -> Array:
    """(N, 3, 3) change of objects that keep their place in the robot's frame: Ad of the robot as they see it."""
    return se2.adjoint(se2.between(states, np.broadcast_to(robot, states.shape)))


def _marginals(stack: Stack, mode: Mode) -> tuple[Array, Array]:
    """(K, 1 + D, d) states at the modes and their covariances, in the tangent spaces there."""
    tangent = stack.tangent(mode.y)
    states = stack.manifold.retract(stack.mean, tangent)
    covariance = stack.root @ np.linalg.solve(mode.hessian, np.swapaxes(stack.root, -1, -2))
    count, dimension = stack.mean.shape[1], stack.dimension
    diagonal = np.einsum("bnpnq->bnpq", covariance.reshape(len(tangent), count, dimension, count, dimension))
    chart = stack.manifold.retract_jacobian(tangent)
    return states, chart @ diagonal @ np.swapaxes(chart, -1, -2)


def _lineage_steps(rows: Rows, object_ids: Sequence[int]) -> list[LineageStep]:
    association = np.array([*object_ids, -1], dtype=int)[rows.objects]
    classes = np.full_like(association, -1) if rows.classes is None else rows.classes
    return [LineageStep(tuple(a), tuple(c)) for a, c in zip(association.tolist(), classes.tolist(), strict=True)]


def _distances(states: Array, point: Array) -> Array:
    """(O,) metres."""
    return np.asarray(np.hypot(states[:, 0] - point[0], states[:, 1] - point[1]))


def _position_sigma(covariance: Array) -> float:
    """Largest standard deviation of a position [m]."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance[:2, :2])[-1], 0.0)))


def _ranges_and_bearings(step: Step) -> tuple[Array, Array]:
    ranges = np.array([detection.range_m for detection in step.detections], dtype=np.float64)
    return ranges, np.array([detection.bearing_rad for detection in step.detections], dtype=np.float64)
