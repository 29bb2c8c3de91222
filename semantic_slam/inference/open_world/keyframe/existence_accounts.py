"""What a keyframe says of the existence of objects (detected, missed, born) and of the sensor's detection rates."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index, places_among
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.existence import LEAST_PROBABILITY, log_miss
from semantic_slam.inference.open_world.keyframe.associated_pairs import associated_pairs
from semantic_slam.inference.open_world.keyframe.candidate_existence import CandidateExistence
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.states.in_view import PredictedDetections
from semantic_slam.inference.states.lineage import MOVES
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate
from semantic_slam.inference.world.problem import Problem


class ExistenceAccounts:
    """Log factors and existence updates of one keyframe's candidates; ``born`` (D,) ids of the objects it may start."""

    def __init__(self, problem: Problem, step: Step, predictions: Sequence[Prediction], born: Index) -> None:
        self._problem, self._step, self._predictions, self._born = problem, step, predictions, born

    def of(self, assignments: Assignments, object_ids: Index) -> tuple[Array, "ExistenceUpdates"]:
        """(K,) log factors of births, detections and misses, and the updates; ``object_ids`` (K, D) as associated."""
        moves = np.zeros(object_ids.shape, dtype=bool)
        if assignments.classes is not None:
            moves = assignments.classes == MOVES
        factors, places = np.empty(len(assignments)), np.empty(len(assignments), dtype=int)
        accounts = []
        for parent, prediction in enumerate(self._predictions):
            rows = np.flatnonzero(assignments.parents == parent)
            own = self._of_parent(prediction, assignments.take(rows), object_ids[rows], moves[rows])
            factors[rows], places[rows] = own.log_factors, np.arange(len(rows))
            accounts.append(own)
        return factors, ExistenceUpdates(accounts, assignments.parents, places)

    def _of_parent(
        self, prediction: Prediction, candidates: Assignments, object_ids: Index, moves: Flags
    ) -> "_ParentAccounts":
        """The accounts of one parent's candidates; ``moves`` (K, D): which detections are of what moves.

        Detections are predicted from the candidates' modes, averaged over where the robot still may be.
        """
        reached, (sensors, which) = prediction.component.objects.ids[prediction.in_reach], prediction.rates.sensors
        columns, are_reached = places_among(reached, object_ids)
        pairs = np.nonzero(are_reached & ~moves)
        predicted, seen = geometry_of(prediction.component.spaces).detections_at(
            prediction.region,
            sensors,
            prediction.objects,
            candidates.column("robot"),
            candidates.column("robot_covariance"),
            self._step,
            associated_pairs(self._problem, prediction, candidates, pairs, columns[pairs]),
        )
        found = np.zeros((*object_ids.shape, len(prediction.rates)))
        found[pairs] = seen[:, which]
        return _ParentAccounts(
            prediction=prediction,
            settings=self._problem.open_world,
            predicted=predicted,
            object_ids=object_ids,
            is_new=object_ids >= self._born.min(initial=np.iinfo(int).max),
            moves=moves,
            found=found,
        )


@dataclass(frozen=True, kw_only=True)
class _ParentAccounts:
    """The accounts of the K candidates of one parent with O objects; each associates all D detections."""

    prediction: Prediction
    settings: OpenWorldConfiguration
    predicted: PredictedDetections  # from the K modes, of those in reach if standing still, by sensor
    object_ids: Index  # (K, D)
    is_new: Flags  # (K, D) whether the detection is a first one (birth)
    moves: Flags  # (K, D) whether it is of an object that moves
    found: Array  # (K, D, G) detection probability of its object given the detection; 0 for one out of reach

    @cached_property
    def standing(self) -> Array:
        """(K, O, G) detection probabilities of what stands still."""
        standing = np.zeros((len(self.object_ids), *self.prediction.existence.shape))
        standing[:, self.prediction.in_reach] = self.predicted.detected[..., self.prediction.rates.sensors[1]]
        return standing

    @cached_property
    def detected(self) -> Array:
        """(K, O, G) detection probabilities."""
        return self.prediction.detected_at_all(self.standing)

    @cached_property
    def log_missed(self) -> Array:
        """(K, O, G) log probabilities of missing each object."""
        return log_miss(self.prediction.existence, self.detected)

    @property
    def log_factors(self) -> Array:
        """(K,) log factors, averaged over the sensor settings."""
        return self._explained[0]

    @cached_property
    def _explained(self) -> tuple[Array, Array]:
        """(K,) log factors, and (K, G) log weights of the sensor settings after this keyframe."""
        return self.prediction.rates.explained(
            self._log_nothing + self._log_standing + self._log_born + self._log_moving
        )

    @property
    def _log_nothing(self) -> Array:
        """(K, G) log likelihoods of a keyframe without detections."""
        prediction = self.prediction
        total = self.log_missed.sum(axis=1) - (prediction.rates.clutter_per_frame + prediction.expected_births)
        if prediction.movers is not None:
            total = total + prediction.movers.log_missed.sum(axis=0)
        return np.asarray(total)

    @property
    def _log_standing(self) -> Array:
        """(K, G) log ratios of detecting objects that stand still to missing them."""
        prediction, pairs = self.prediction, np.nonzero(~self.is_new & ~self.moves)
        rows = prediction.component.objects.rows(self.object_ids[pairs])
        stands = prediction.existence[rows] * prediction.stands[rows]
        seen = np.maximum(stands * np.maximum(self.found[pairs], prediction.least_detected), LEAST_PROBABILITY)
        return self._by_candidate(pairs, np.log(seen) - self.log_missed[pairs[0], rows])

    @property
    def _log_born(self) -> Array:
        """(K, G) log ratios of first detections to their stand-in priors."""
        pairs = np.nonzero(self.is_new)
        return self._by_candidate(pairs, self.prediction.log_born[pairs[1]])

    @property
    def _log_moving(self) -> Array | float:
        """(K, G) log ratios of detecting objects that move, or may move, to missing them; 0 where nothing moves."""
        movers, pairs = self.prediction.movers, np.nonzero(self.moves)
        if movers is None:
            return 0.0
        found = movers.log_detected(self.prediction.least_detected, self.log_missed, self.prediction.undecided)
        return self._by_candidate(pairs, found[pairs[0], movers.movers.rows(self.object_ids[pairs])])

    def _by_candidate(self, pairs: tuple[Index, ...], values: Array) -> Array:
        """(K, G) sums of (n, G) values of pairs of a candidate and a detection."""
        every = np.zeros(self.found.shape)
        every[pairs] = values
        return np.asarray(every.sum(axis=1))

    def of(self, candidate: int) -> CandidateExistence:
        """The account of one candidate."""
        ids, is_new, moves = self.object_ids[candidate], self.is_new[candidate], self.moves[candidate]
        seen_by = np.flatnonzero(~is_new & ~moves)
        return CandidateExistence(
            prediction=self.prediction,
            settings=self.settings,
            predicted=self.predicted.of(candidate),
            standing=self.standing[candidate],
            detected=self.detected[candidate],
            log_missed=self.log_missed[candidate],
            observed=self.prediction.component.objects.rows(ids[seen_by]),
            seen_by=seen_by,
            found=self.found[candidate, seen_by],
            moving_ids=ids[moves],
            new=np.flatnonzero(is_new),
            new_ids=ids[is_new],
            log_weights=self._explained[1][candidate],
        )


class ExistenceUpdates(Sequence[ExistenceUpdate]):
    """The existence updates of K candidates, computed on access: few candidates survive."""

    def __init__(self, accounts: Sequence[_ParentAccounts], parents: Index, places: Index) -> None:
        """``parents`` (K,), and ``places`` (K,) of the candidates among those of their parents."""
        self._accounts, self._parents, self._places = accounts, parents, places

    def __len__(self) -> int:
        return len(self._parents)

    def __getitem__(self, row: int) -> ExistenceUpdate:  # type: ignore[override]
        account = self._accounts[int(self._parents[row])].of(int(self._places[row]))
        return account.update()
