"""What a keyframe says of the existence of objects (detected, missed, born) and of the sensor's detection rates."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.existence import LEAST_PROBABILITY, existence_after_miss, log_miss
from semantic_slam.inference.open_world.keyframe.associated_pairs import associated_pairs
from semantic_slam.inference.open_world.planar.detection_probability import LEAST_DETECTION_SHARE
from semantic_slam.inference.open_world.prediction.nearby import views_of
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.open_world.seen_again import SeenAgain
from semantic_slam.inference.states.lineage import MOVES
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate
from semantic_slam.inference.states.views import Looks, Views
from semantic_slam.inference.world.problem import Problem


def least_detected(settings: OpenWorldConfiguration) -> float:
    """Lower bound on the detection probability of an object that was in fact detected."""
    return LEAST_DETECTION_SHARE * settings.detection_probability


class ExistenceAccounts:
    """Log factors and existence updates of one keyframe's candidates; ``born`` (D,) ids of the objects it may start."""

    def __init__(self, problem: Problem, step: Step, predictions: Sequence[Prediction], born: Index) -> None:
        self._problem, self._step, self._predictions, self._born = problem, step, predictions, born

    def of(self, assignments: Assignments, object_ids: Index) -> tuple[Array, "ExistenceUpdates"]:
        """(K,) log factors of births, detections and misses, and the updates; ``object_ids`` (K, D) as associated."""
        moves = np.zeros(object_ids.shape, dtype=bool)
        if assignments.classes is not None:
            moves = assignments.classes == MOVES
        accounts: list[_Account] = [None] * len(assignments)  # type: ignore[list-item]
        for parent, prediction in enumerate(self._predictions):
            rows = np.flatnonzero(assignments.parents == parent)
            own = assignments.take(rows)
            seen = associated_pairs(self._problem, prediction, own, object_ids[rows], ~moves[rows])
            looks, found = self._looks(prediction, own, seen)
            for at, row in enumerate(rows.tolist()):
                mine = seen.candidates == at
                standing = prediction.in_reach[seen.columns[mine]], found[mine]
                if_missed = _IfMissed(prediction, looks.of(at), standing, self._problem.open_world)
                accounts[row] = _Account.of(if_missed, object_ids[row], moves[row], self._born)
        return np.array([own.log_factor for own in accounts]), ExistenceUpdates(accounts)

    def _looks(self, prediction: Prediction, rows: Assignments, seen: SeenAgain) -> tuple[Looks, Array]:
        """Looks at the objects in reach from the candidates' modes, averaged over where the robot still may be.

        With the (n, G) detection probabilities of those ``seen``.
        """
        return geometry_of(prediction.component.spaces).detections_at(
            prediction.region,
            prediction.rates,
            prediction.objects,
            rows.column("robot"),
            rows.column("robot_covariance"),
            self._step,
            seen,
        )


class _IfMissed:
    """A parent's O objects at one candidate's mode: log factors and existence if missed, and the change if detected."""

    def __init__(
        self, prediction: Prediction, looks: Looks, seen: tuple[Index, Array], settings: OpenWorldConfiguration
    ) -> None:
        """``looks`` (K = 1) at the objects in reach, if they stand still.

        ``seen``: rows (n,) of those detected, and their (n, G) detection probabilities given their detections.
        """
        self.prediction, self.looks, self.settings = prediction, looks, settings
        self.least = least_detected(settings)
        self.standing = np.zeros(prediction.existence.shape)  # (O, G) detection probability of what stands still
        self.standing[prediction.in_reach] = looks.detected[0]
        self.seen = np.zeros(prediction.existence.shape)  # (O, G) of what was detected and stands still
        self.seen[seen[0]] = seen[1]
        self.detected = prediction.detected_at_all(self.standing[None])[0]  # (O, G)
        self.log_missed = log_miss(prediction.existence, self.detected)  # (O, G)

    @cached_property
    def existence(self) -> Array:
        """(O, G) existence of the objects if they are missed."""
        return existence_after_miss(self.prediction.existence, self.detected)

    @cached_property
    def log_total(self) -> Array:
        """(G,) log likelihood of a keyframe without detections."""
        expected = self.prediction.rates.clutter_per_frame + self.prediction.expected_births
        total = self.log_missed.sum(axis=0) - expected
        if self.prediction.movers is not None:
            total = total + self.prediction.movers.log_missed.sum(axis=0)
        return np.asarray(total)

    def log_detected(self, rows: Index) -> Array:
        """(n, G) log ratio of detecting objects that stand still to missing them."""
        stands = self.prediction.existence[rows] * self.prediction.stands[rows]
        seen = np.maximum(stands * np.maximum(self.seen[rows], self.least), LEAST_PROBABILITY)
        return np.asarray(np.log(seen) - self.log_missed[rows])

    @cached_property
    def log_moving(self) -> Array:
        """(T, G) log ratio of detecting objects that move, or may move, to missing them."""
        movers = self.prediction.movers
        assert movers is not None
        return movers.log_detected(self.least, self.log_missed, self.prediction.undecided)

    @cached_property
    def stands(self) -> Array:
        """(O, G) probability that an object stands still, if it exists and was missed."""
        return np.asarray(self.prediction.stands * (1.0 - self.standing) / (1.0 - self.detected))


@dataclass(frozen=True)
class _Account:
    """The account of one candidate; n of its D detections are first detections (births)."""

    if_missed: _IfMissed
    observed: Index  # rows of the objects detected that stand still
    moving_ids: Index  # ids of the objects detected that move
    new: Index  # (n,) detections that are births
    new_ids: Index  # (n,)
    log_factor: float
    log_weights: Array  # (G,) log weights of the sensor settings after this keyframe
    seen_by: Index  # detections of the objects in ``observed``

    @classmethod
    def of(cls, if_missed: _IfMissed, association: Index, moves: Flags, born: Index) -> "_Account":
        """The account of an ``association`` with (D,) objects, of which some ``moves`` (D,)."""
        prediction = if_missed.prediction
        is_new = association >= born[0] if len(born) else np.zeros(0, dtype=bool)
        seen_by = np.flatnonzero(~is_new & ~moves)
        observed = prediction.component.objects.rows(association[seen_by])
        new = np.flatnonzero(is_new)
        total = if_missed.log_total + if_missed.log_detected(observed).sum(axis=0)
        if len(new):
            total = total + prediction.log_born[new].sum(axis=0)
        moving_ids = association[moves]
        if len(moving_ids):
            assert prediction.movers is not None
            total = total + if_missed.log_moving[prediction.movers.movers.rows(moving_ids)].sum(axis=0)
        factor, weights = prediction.rates.explained(total)
        return cls(if_missed, observed, moving_ids, new, association[new], factor, weights, seen_by)

    def update(self) -> ExistenceUpdate:
        """The existence update of the parent's objects, under the sensor settings that keep enough weight."""
        if_missed, prediction = self.if_missed, self.if_missed.prediction
        rates, left = prediction.rates.reweighed(self.log_weights)
        existence, stands = if_missed.existence[:, left].copy(), if_missed.stands[:, left]
        existence[self.observed] = 1.0
        gone = self._gone(left)
        probable = rates.average(existence)
        if prediction.movers is not None:
            probable = rates.average(existence * stands)
            probable[self.observed] = 1.0
        if gone is not None:
            probable = probable + rates.average(gone)
        kept = (probable >= if_missed.settings.least_existence) & ~np.isin(
            prediction.component.objects.ids, self.moving_ids
        )
        return ExistenceUpdate(
            existence=existence,
            kept=np.asarray(kept),
            new_ids=self.new_ids,
            new_existence=prediction.birth_existence[np.ix_(self.new, np.flatnonzero(left))],
            rates=rates,
            rates_kept=None if left.all() else left,
            views=self._views(kept).with_rates(left),
            gone=gone,
            stamp_ns=prediction.population.stamp_ns,
            moving=None if prediction.movers is None else 1.0 - stands,
            track_scores=self._track_scores[:, left],
        )

    @property
    def _track_scores(self) -> Array:
        """(O, G) track scores, those of detected objects without the density of their detections."""
        if_missed, prediction = self.if_missed, self.if_missed.prediction
        population = prediction.population
        assert population.track_scores is not None
        gone = 0.0 if population.gone is None else population.gone
        there = prediction.existence / np.maximum(prediction.existence + gone, LEAST_PROBABILITY)  # if it is a thing
        after = population.track_scores + log_miss(there, if_missed.detected)
        seen = self.observed
        found = there[seen] * prediction.stands[seen] * np.maximum(if_missed.seen[seen], if_missed.least)
        after[seen] = population.track_scores[seen] + np.log(np.maximum(found, LEAST_PROBABILITY))
        after[seen] -= prediction.log_false_alarm[self.seen_by]
        return np.asarray(after)

    def _gone(self, left: Flags) -> Array | None:
        """(O, G) probability that an object has left, which a miss makes likelier; None: objects do not leave."""
        before = self.if_missed.prediction.population.gone
        if before is None:
            return None
        gone = before[:, left] * np.exp(-self.if_missed.log_missed[:, left])
        gone[self.observed] = 0.0
        return np.asarray(gone)

    def _views(self, kept: Flags) -> Views:
        """What is known of being in view, of the objects ``kept`` (O,), then of the new ones."""
        prediction = self.if_missed.prediction
        runs, reach = prediction.rates.runs, prediction.in_reach
        seen = np.isin(reach, self.observed)
        in_reach = self.if_missed.looks.after(seen, runs)
        all_objects = views_of(prediction.population).unreached(runs).updated(reach, in_reach)
        return all_objects.take(kept).joined(all_objects.started(len(self.new), runs))


class ExistenceUpdates(Sequence[ExistenceUpdate]):
    """The existence updates of K candidates, computed on access: few candidates survive."""

    def __init__(self, accounts: Sequence[_Account]) -> None:
        self._accounts = accounts

    def __len__(self) -> int:
        return len(self._accounts)

    def __getitem__(self, row: int) -> ExistenceUpdate:  # type: ignore[override]
        return self._accounts[row].update()
