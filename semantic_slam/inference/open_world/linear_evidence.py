"""Weights and modes of joint assignments from one linearisation at the prediction, where that is enough.

Objects are distinct, so that the measurements of K assignments with the same number of known objects stack into
systems of one size. Detections that start an object tell nothing of the robot: they follow from its mode.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.small_matrices import inverted
from semantic_slam.inference.association.gating import PairDensities
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.models.correlated_errors import PredictedErrors
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.prediction import Prediction
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True, kw_only=True)
class _Results:
    """Columns of K assignments that are filled row by row."""

    log_evidence: Array  # (K,) of the detections, those that start an object under their stand-in
    robot: Array  # (K, s) modes
    robot_covariance: Array  # (K, r, r)
    object_states: Array  # (K, D, s) NaN of no object
    object_covariances: Array  # (K, D, l, l)
    bend: Array  # (K,)
    innovation_nees: Array  # (K,) NaN without a known object

    @classmethod
    def empty(cls, shape: tuple[int, ...], spaces: Spaces) -> "_Results":
        """To be filled, (K, D) in shape."""
        count, detections = shape
        storage, r, own = spaces.storage, spaces.layout.robot, spaces.layout.landmark
        return cls(
            log_evidence=np.zeros(count),
            robot=np.empty((count, storage.robot)),
            robot_covariance=np.empty((count, r, r)),
            object_states=np.full((count, detections, storage.landmark), np.nan),
            object_covariances=np.full((count, detections, own, own), np.nan),
            bend=np.zeros(count),
            innovation_nees=np.full(count, np.nan),
        )


@dataclass(frozen=True)
class JointInnovation:
    """Whitened residuals of n detections before they are taken in, with a robot and n objects, k coordinates."""

    residual: Array  # (m,)
    jacobian: Array  # (m, k)
    cross: Array  # (m, k) covariance with robot and objects
    covariance: Array  # (m, m)
    log_normalisers: list[float]  # n


class LinearisedEvidence:
    """The predicted Gaussian of one parent with its linearised detections."""

    def __init__(
        self,
        spaces: Spaces,
        mean: Array,
        covariance: Array,
        pairs: PairDensities,
        births: list[Birth],
        turns: Array,
        errors: PredictedErrors | None = None,
    ):
        """``mean`` (1 + M, s) and ``covariance`` of robot and near objects; ``turns`` (D,) sigmas of bearings [rad].

        ``errors`` of the detections where these repeat, the ``pairs`` being whitened accordingly.
        """
        self.spaces, self.mean, self.covariance = spaces, mean, covariance
        self.pairs, self.births, self.turns, self.errors = pairs, births, turns, errors
        self.layout, self.known = spaces.layout, len(mean) - 1

    @classmethod
    def of(cls, spaces: Spaces, prediction: Prediction, pairs: PairDensities) -> Self:
        """That of one parent, with the ``pairs`` of its detections and near objects."""
        return cls(
            spaces,
            prediction.predicted.mean[0],
            prediction.predicted.covariance[0],
            pairs,
            prediction.births,
            np.sqrt([d.covariance[1, 1] if d.has_range else np.inf for d in prediction.detections]),
            prediction.errors,
        )

    def evaluate(self, assignments: Assignments, columns: Index) -> Assignments:
        """Assignments with evidence and states.

        ``columns`` (K, D): object, M + i where detection i starts one, or -1 where it is of none and counts nothing.
        """
        results = _Results.empty(columns.shape, self.spaces)
        for row in range(len(columns)):
            self._row(columns[row], results, row)
        return assignments.gaining(**vars(results))

    def _row(self, columns: Index, result: _Results, row: int) -> None:
        seen = [number for number, column in enumerate(columns.tolist()) if 0 <= column < self.known]
        places = self._places(columns, seen)
        prior = self.covariance[places[:, None], places]
        shift, after = np.zeros(len(places)), prior
        if seen:
            joint = self.innovation(columns, seen)
            residual, jacobian, cross = joint.residual, joint.jacobian, joint.cross
            inverse, log_determinant = inverted(joint.covariance)
            weighted = inverse @ residual
            shift = -weighted @ cross
            after = prior - cross.T @ inverse @ cross
            squared, degrees = float(residual @ weighted), np.count_nonzero(jacobian.any(axis=1))
            result.log_evidence[row] = sum(joint.log_normalisers) - 0.5 * squared - 0.5 * log_determinant
            result.innovation_nees[row] = squared / degrees
        self._fill(result, row, columns, seen, self.layout.blocks(shift), after)
        if seen:
            result.bend[row] = self._bend(seen, jacobian @ shift, joint.covariance.diagonal() - 1.0)

    def _places(self, columns: Index, seen: list[int]) -> Index:
        """Rows of the robot and of the objects of the detections ``seen``."""
        return self.layout.rows([0, *(1 + int(columns[number]) for number in seen)])

    def innovation(self, columns: Index, seen: list[int]) -> JointInnovation:
        """The detections ``seen`` together, before they are taken in; ``columns`` (D,): of which object each is."""
        places = self._places(columns, seen)
        residual, jacobian, log_normalisers = self._system(columns, seen)
        cross = jacobian @ self.covariance[places[:, None], places]
        covariance = cross @ jacobian.T
        if self.errors is not None:
            repeated = self._repeated(self.errors, seen, places)
            cross += repeated.T
            both = jacobian @ repeated
            covariance += both + both.T + self._repeated_noise(self.errors, seen)
        covariance.flat[:: len(residual) + 1] += 1.0
        return JointInnovation(residual, jacobian, cross, covariance, log_normalisers)

    @staticmethod
    def _repeated(errors: PredictedErrors, seen: list[int], places: Index) -> Array:
        """(n, m) covariance of the states at ``places`` with the part of the residuals that repeats."""
        return np.asarray(errors.cross[places[:, None], errors.rows(seen)] * errors.slopes[seen].ravel())

    @staticmethod
    def _repeated_noise(errors: PredictedErrors, seen: list[int]) -> Array:
        """(m, m) covariance of that part."""
        rows, slopes = errors.rows(seen), errors.slopes[seen].ravel()
        return np.asarray(slopes[:, None] * errors.covariance[rows[:, None], rows] * slopes)

    def _system(self, columns: Index, seen: list[int]) -> tuple[Array, Array, list[float]]:
        """Whitened residuals (m,), their Jacobian by robot and objects in turn, and the log normaliser of each."""
        parts = [self.pairs.parts[number] for number in seen]
        residual = np.concatenate([part.residual[columns[n]] for part, n in zip(parts, seen, strict=True)])
        jacobian = np.zeros((len(residual), self.layout.size(len(seen))))
        at, log_normalisers = 0, list[float]()
        for place, (part, number) in enumerate(zip(parts, seen, strict=True), start=1):
            own = part.jacobian_robot[columns[number]]
            rows = slice(at, at + len(own))
            jacobian[rows, self.layout.block(0)] = own
            jacobian[rows, self.layout.block(place)] = part.jacobian_object[columns[number]]
            log_normalisers.append(float(part.log_normaliser[columns[number]]))
            at += len(own)
        return residual, jacobian, log_normalisers

    def _bend(self, seen: list[int], change: Array, variances: Array) -> float:
        """A direction that turns by a = sigma c has a^2 / 2 of its distance as its second-order term.

        ``change`` c of the whitened measurements from prediction to mode, and ``variances`` of the prediction.
        """
        squared = np.maximum(change**2, variances).reshape(len(seen), -1).sum(axis=1)
        return float((0.5 * self.turns[seen] * squared).max())

    def _fill(self, result: _Results, row: int, columns: Index, seen: list[int], shift: Array, after: Array) -> None:
        """States and covariances at the mode; charts are those of the prediction, for shifts are small."""
        robot, storage = self.layout.block(0), self.spaces.storage
        own = [0, *(1 + int(columns[number]) for number in seen)]
        states = self.spaces.joint.retract(self.mean[own], shift)
        result.robot[row], result.robot_covariance[row] = states[0, : storage.robot], after[robot, robot]
        for place, number in enumerate(seen, start=1):
            block = self.layout.block(place)
            result.object_states[row, number] = states[place, : storage.landmark]
            result.object_covariances[row, number] = after[block, block]
        for number in [number for number, column in enumerate(columns) if column >= self.known]:
            born = self.births[number]
            moved = born.gain @ shift[0, robot]
            result.object_states[row, number] = self.spaces.landmark.retract(born.prior.mean, moved)
            result.object_covariances[row, number] = born.gain @ after[robot, robot] @ born.gain.T + born.noise
            result.log_evidence[row] += born.log_stand_in
