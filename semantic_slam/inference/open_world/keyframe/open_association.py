"""Open-world data association: objects appear and disappear, and a detection may be a false alarm."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.association.candidate_limit import candidate_limit
from semantic_slam.inference.association.gating import (
    PairDensities,
    RankedAssignments,
    best_assignments,
    may_be_more,
    pair_densities,
)
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.existence import log_miss
from semantic_slam.inference.open_world.joint.costs import JointCosts
from semantic_slam.inference.open_world.joint.linear_evidence import LinearisedEvidence
from semantic_slam.inference.open_world.joint.ranking import JointRanking
from semantic_slam.inference.open_world.keyframe.open_keyframe import OpenKeyframe
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.open_world.prediction.predictor import FrameInput, Predictor
from semantic_slam.inference.open_world.spatial.pair_ranges import log_ranges_of, relative_covariances
from semantic_slam.inference.open_world.spatial.pairs_at_modes import ParentPairs, pairs_at_modes
from semantic_slam.inference.semantics.interface import RanksPairs
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import UnknownObjectsError
from semantic_slam.inference.states.lineage import MOVES, LineageStep
from semantic_slam.inference.world.departures import Departures
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem
from semantic_slam.inference.world.roots import tracking_root


class OpenAssociation:
    """The k best joint assignments of every parent's detections to objects that it knows, or to new ones."""

    defers_view_factors = tracks_objects = True
    needs_map, wants_identities, counts_misses, merges_copies = False, False, True, True

    def __init__(self, problem: Problem, registry: ObjectRegistry) -> None:
        self.problem, self.registry, self.settings = problem, registry, problem.open_world
        departures = Departures(problem.open_world, registry.label_of)
        self.predictor = Predictor(
            problem.model, problem.open_world, problem.detection_errors, problem.moving, departures
        )

    @classmethod
    def suited_to(cls, configuration: Configuration) -> type[Any]:
        """This class, for every configuration."""
        return cls

    @staticmethod
    def check(configuration: Configuration) -> None:
        """Raises InputError for parameters that have no meaning, or another one, in an open world."""
        what = f"association: {configuration.association}"
        if not configuration.distinct_assignment:
            raise InputError(f"{what} has one detection per object and frame; set distinct_assignment: true")
        if configuration.weights.method == "sampled":
            raise InputError(f"{what} has no prior samples; set weights.method: importance or laplace")
        if configuration.visibility.max_range_m > 0.0 or configuration.visibility.field_of_view_rad > 0.0:
            raise InputError(f"{what} has a region instead of visibility.*; set open_world.max_range_m and its angle")
        if configuration.open_world.min_range_m >= configuration.open_world.max_range_m:
            raise InputError("open_world.min_range_m is not below open_world.max_range_m; correct the sensor's region")

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """Reserve ids for the objects that the detections may start."""
        registry.reserve(step.index, len(step.names), step.labels)

    @staticmethod
    def reported(registry: ObjectRegistry, alive: Collection[int]) -> ReportedObjects:
        """The objects that are alive in some hypothesis."""
        return registry.alive(alive)

    def root(self, root_number: int) -> Component:
        """The prior of Eq. 4.3 with the map's existence probabilities, under one odometry noise and start pose."""
        root = tracking_root(self.problem, root_number)
        return replace(root, objects=root.objects.scored()) if self.counts_misses else root

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> OpenKeyframe:
        """The prediction and ranked joint assignments of each parent, or of the one continuation ``path``."""
        wanted = () if path is None else path.association
        predictions = [
            self.predictor.predict(component, _frame_input(step, component), wanted=wanted)
            for component in parents.components
        ]
        if path is not None:
            columns = self._columns(step, predictions[0], path)
            pairs = self.pairs_of(predictions, [_named(columns[0], len(predictions[0].near))])
            ranked = [RankedAssignments(columns, np.zeros(1), -np.inf)]
        else:
            found = zip(predictions, self.pairs_of(predictions), strict=True)
            pairs = [self._with_words(step, prediction, own) for prediction, own in found]
            ranked = [self.ranked(prediction, pair) for prediction, pair in zip(predictions, pairs, strict=True)]
        return OpenKeyframe(
            problem=self.problem,
            registry=self.registry,
            step=step,
            parents=parents,
            path=path,
            predictions=predictions,
            pairs=pairs,
            ranked=ranked,
        )

    def pairs_of(self, predictions: Sequence[Prediction], asked: Sequence[Flags] | None = None) -> list[PairDensities]:
        """Densities of each parent's detections under each object near them.

        ``asked`` (D, M) for each parent: the pairs whose densities matter, where that is known; None: all.
        """
        every = [self._at_prediction(prediction) for prediction in predictions]
        parents = {
            number: ParentPairs(
                detections=own.detections,
                predicted=own.predicted,
                anchors=own.anchors,
                pairs=pairs,
                asked=None if asked is None else asked[number],
            )
            for number, (own, pairs) in enumerate(zip(predictions, every, strict=True))
            if own.anchors is not None
        }
        found = pairs_at_modes(self.problem.spaces, self.problem.model, list(parents.values()))
        for number, pairs in zip(parents, found, strict=True):
            every[number] = pairs
        return every

    def _with_words(self, step: Step, prediction: Prediction, pairs: PairDensities) -> PairDensities:
        """The pairs with the evidence of detector labels, where rays (bearings without range) leave many possible."""
        spaces, semantics, predicted = self.problem.spaces, self.problem.semantics, prediction.predicted
        if prediction.anchors is None or step.words is None or not isinstance(semantics, RanksPairs):
            return pairs
        near = prediction.near_ids.tolist()
        log_prior = self.registry.log_class_prior_of([*near, self.registry.first_new_id(step.index)])
        robot, objects = predicted.mean[0, 0, : spaces.storage.robot], predicted.mean[0, 1:, : spaces.storage.landmark]
        around = relative_covariances(spaces, robot, objects, predicted.pair_covariances[0])
        ranges = log_ranges_of(spaces, prediction.detections, robot, objects, around)
        return replace(pairs, log_words=semantics.log_pairs(step, prediction.component.views, near, log_prior, *ranges))

    def _at_prediction(self, prediction: Prediction) -> PairDensities:
        """Densities of the detections under each object near them, linearised at the prediction."""
        return pair_densities(
            self.problem.spaces,
            self.problem.model,
            prediction.detections,
            prediction.predicted,
            prediction.errors,
            self.problem.tail_of(prediction.component),
        )

    def ranked(self, prediction: Prediction, pairs: PairDensities) -> RankedAssignments:
        """The joint assignments of one parent that are to be weighed.

        They are ranked by the sum of independent pair weights, or with ``joint_ranking`` by the linearised joint
        evidence. Pair weights are averaged over the sensor settings, with the weights that a keyframe without
        detections would leave them. Columns are the near objects, then the D objects that the detections may start,
        then the moving objects.
        """
        log_weights, log_detected, log_missed, log_new = self._log_options(prediction)
        if pairs.log_words is not None:
            log_detected, log_new = log_detected + pairs.log_words[:, :-1], log_new + pairs.log_words[:, -1]
        log_known = pairs.log_density + log_detected
        admitted = pairs.distance < self.settings.gate_sigma
        admitted |= self._outliers(pairs, log_known, log_new)
        moving, may_move, objects = self._moving(prediction, log_known, admitted, log_new, log_missed, log_weights)
        options = np.concatenate([admitted, may_move], axis=1)
        most = candidate_limit(self.problem.open_weights, len(log_new))
        ranked = partial(
            best_assignments,
            admitted=options,
            log_new=log_new,
            limit=most,
            gate=self.problem.open_weights.gate,
            log_beyond=prediction.log_beyond,
            objects=objects,
        )
        log_pairs = np.concatenate([log_known, moving], axis=1)
        if self.settings.joint_ranking and admitted.any() and may_be_more(options, most):
            alone = np.concatenate([moving, log_new[:, None]], axis=1)
            linear = LinearisedEvidence.of(self.problem.spaces, prediction, pairs)
            found = JointRanking(
                costs=JointCosts.of(linear, admitted, log_detected, alone),
                log_pairs=log_pairs,
                admitted=options,
                ranked=ranked,
                reach=float(np.log(self.problem.pruning.ratio)),
            ).best(most, self.problem.open_weights.gate)
        else:
            found = ranked(log_pairs)
        return replace(found, columns=_movers_last(found.columns, len(prediction.near), moving.shape[1]))

    @staticmethod
    def _log_options(prediction: Prediction) -> tuple[Array, Array, Array, Array]:
        """Log weights of the options of a detection apart from where it is, averaged over the G sensor settings.

        (G,) of the settings after a keyframe without detections; (M,) of a near object's detection relative to its
        miss; (O, G) of misses; (D,) of births and false alarms.
        """
        near = prediction.near
        log_missed = log_miss(prediction.existence, prediction.detected_at_all(prediction.detected[None])[0])
        stands = prediction.existence[near] * prediction.stands[near]
        with np.errstate(divide="ignore"):
            log_ratio = np.log(stands * np.maximum(prediction.detected[near], prediction.least_detected))
            log_ratio = log_ratio - log_missed[near]
        _, log_weights = prediction.rates.explained(log_missed.sum(axis=0) - prediction.expected_births)
        log_detected = np.logaddexp.reduce(log_weights + log_ratio, axis=1)
        log_new = np.logaddexp.reduce(log_weights + prediction.log_intensity, axis=1)
        log_new += np.array([birth.log_area for birth in prediction.births])
        return log_weights, log_detected, log_missed, log_new

    def _outliers(self, pairs: PairDensities, log_known: Array, log_new: Array) -> Flags:
        """(D, M) outlier pairs whose weight is not negligible beside the alternatives of their detections."""
        if pairs.outlier_distance is None:
            return np.zeros(log_known.shape, dtype=bool)
        near = pairs.distance < self.settings.gate_sigma
        best = np.maximum(log_new, np.where(near, log_known, -np.inf).max(axis=1, initial=-np.inf))
        likely = log_known > best[:, None] - np.log(self.problem.pruning.ratio)
        return np.asarray(likely & (pairs.outlier_distance < self.settings.gate_sigma))

    def _moving(
        self,
        prediction: Prediction,
        log_known: Array,
        admitted: Flags,
        log_new: Array,
        log_missed: Array,
        log_weights: Array,
    ) -> tuple[Array, Flags, Index | None]:
        """(D, T) log weights of pairs with moving objects, (D, T) which are admitted, and ids of near and moving."""
        movers = prediction.movers
        if movers is None or not len(movers):
            nothing = np.zeros((len(log_new), 0))
            return nothing, nothing > 0.0, None
        density, distance = movers.pairs(prediction.observer)
        found = movers.log_detected(prediction.least_detected, log_missed, prediction.undecided)
        by_rates = log_weights + found
        moving = density + np.logaddexp.reduce(by_rates, axis=1)
        best = np.maximum(log_new, np.where(admitted, log_known, -np.inf).max(axis=1, initial=-np.inf))
        likely = moving > best[:, None] - np.log(self.problem.pruning.ratio)
        ids = np.concatenate([prediction.near_ids, movers.movers.ids])
        return moving, likely & (distance < self.settings.gate_sigma), ids

    def _columns(self, step: Step, prediction: Prediction, path: LineageStep) -> Index:
        """(1, D) columns of the association that a lineage names. Raises UnknownObjectsError."""
        born = self.registry.first_new_id(step.index) + np.arange(len(step.detections))
        place = {(n, False): column for column, n in enumerate([*prediction.near_ids.tolist(), *born.tolist()])}
        if prediction.movers is not None:
            ids = prediction.movers.movers.ids.tolist()
            place |= {(n, True): column for column, n in enumerate(ids, start=len(place))}
        named = [(n, own == MOVES) for n, own in zip(path.association, path.class_assignment, strict=True)]
        unknown = [n for n, is_moving in named if (n, is_moving) not in place]
        if unknown:
            raise UnknownObjectsError(unknown)
        return np.array([place[own] for own in named], dtype=int).reshape(1, -1)


def _movers_last(columns: Index, num_near: int, num_moving: int) -> Index:
    """(B, D) columns in the order near, new, moving objects, from those in the order near, moving, new."""
    num_new = columns.shape[1]
    is_near, is_old = columns < num_near, columns < num_near + num_moving
    return columns + np.where(is_near, 0, np.where(is_old, num_new, -num_moving))


def _frame_input(step: Step, component: Component) -> FrameInput:
    """The prediction's input at a step, with the covariances that the component assumes."""
    return FrameInput(
        motion=step.motion,
        detections=component.sensed(step.detections),
        sensed=step.camera or step.sensed,
        stamp_ns=step.stamp_ns,
        labels=step.labels,
    )


def _named(columns: Index, known: int) -> Flags:
    """(D, M) which pairs of a detection and one of M known objects the columns (D,) of a joint assignment name."""
    return np.asarray(columns[:, None] == np.arange(known))
