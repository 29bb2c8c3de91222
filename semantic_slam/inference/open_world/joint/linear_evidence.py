"""Evidence and modes of joint assignments from one linearisation at the prediction, where that is accurate.

Objects are distinct, so the measurements of K assignments with equally many known objects stack into systems of one
size. Detections that start an object carry no information on the robot: their objects follow from its mode.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.association.gating import PairDensities
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.outlier_choices import OutlierChoices
from semantic_slam.inference.models.correlated_errors import PredictedErrors
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.states.range_chart import moved
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True, kw_only=True)
class _Results:
    """Columns of K assignments that are filled row by row."""

    log_evidence: Array  # (K,) of the detections, births under their stand-in priors
    robot: Array  # (K, s) modes
    robot_covariance: Array  # (K, r, r)
    sensor: Array  # (K, d) constant errors of the sensor
    sensor_covariance: Array  # (K, d, r + d)
    object_states: Array  # (K, D, s) NaN without an object
    object_covariances: Array  # (K, D, l, l)
    object_crosses: Array  # (K, D, r, l)
    bend: Array  # (K,)
    innovation_nees: Array  # (K,) NaN without a known object
    outlier: Flags  # (K, D) which are taken for position outliers
    outlier_probability: Array  # (K, D)

    @classmethod
    def empty(cls, shape: tuple[int, ...], spaces: Spaces, sensor: tuple[Array, Array]) -> "_Results":
        """Unfilled results, (K, D) in shape; of the ``sensor`` as predicted."""
        count, detections = shape
        storage, r, own = spaces.storage, spaces.layout.robot, spaces.layout.landmark
        return cls(
            log_evidence=np.zeros(count),
            robot=np.empty((count, storage.robot)),
            robot_covariance=np.empty((count, r, r)),
            sensor=np.repeat(sensor[0][None], count, axis=0),
            sensor_covariance=np.repeat(sensor[1][None], count, axis=0),
            object_states=np.full((count, detections, storage.landmark), np.nan),
            object_covariances=np.full((count, detections, own, own), np.nan),
            object_crosses=np.full((count, detections, r, own), np.nan),
            bend=np.zeros(count),
            innovation_nees=np.full(count, np.nan),
            outlier=np.zeros(shape, dtype=bool),
            outlier_probability=np.zeros(shape),
        )


@dataclass(frozen=True)
class JointInnovation:
    """Joint innovation of n detections: whitened residuals against a robot and n objects, k coordinates.

    For each of G assignments, or (without that axis) for one.
    """

    residual: Array  # (G, m)
    jacobian: Array  # (G, m, k)
    cross: Array  # (G, m, k) covariance with robot and objects
    covariance: Array  # (G, m, m)
    log_normalisers: Array  # (G, n)

    @property
    def measured(self) -> Flags:
        """(G, n, m / n) which residual components of each detection are measured."""
        return np.asarray(self.jacobian.any(axis=-1).reshape(*self.log_normalisers.shape, -1))


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
        anchors: Array | None = None,
        sensor: tuple[Array, Array] | None = None,
    ):
        """``mean`` (1 + M, s) and ``covariance`` of robot and near objects; ``turns`` (D,) sigmas of bearings [rad].

        ``errors`` of the detections where these are correlated, the ``pairs`` being whitened accordingly; ``anchors``
        (M, 3) from where objects were first seen along a ray alone, NaN of others. ``sensor``: (d,) expected constant
        errors, and their (d, r + d) covariance with the robot and among each other; None: none are estimated.
        """
        self.spaces, self.mean, self.covariance = spaces, mean, covariance
        self.births, self.turns, self.errors = births, turns, errors
        self.layout, self.known, self.tail = spaces.layout, len(mean) - 1, pairs.tail
        self._part, self._pairs, self._anchors = pairs.part, pairs, anchors
        self._sensor = (np.zeros(0), np.zeros((0, self.layout.robot))) if sensor is None else sensor

    @classmethod
    def of(cls, spaces: Spaces, prediction: Prediction, pairs: PairDensities) -> Self:
        """The evidence of one parent, from the ``pairs`` of its detections and near objects."""
        return cls(
            spaces,
            prediction.predicted.mean[0],
            prediction.predicted.covariance[0],
            pairs,
            prediction.births,
            np.sqrt([d.turn_variance for d in prediction.detections]),
            prediction.errors,
            prediction.anchors,
            prediction.sensor,
        )

    def evaluate(self, assignments: Assignments, columns: Index) -> Assignments:
        """Assignments with evidence and states at their modes.

        ``columns`` (K, D): object; M + i where detection i starts one; -1 where it is ignored, being clutter or weighed
        elsewhere.
        """
        results = _Results.empty(columns.shape, self.spaces, self._sensor)
        shift = np.empty((len(columns), self.layout.robot))
        is_known = (columns >= 0) & (columns < self.known)
        counts = is_known.sum(axis=1)
        for count in np.unique(counts).tolist():
            rows = np.flatnonzero(counts == count)
            seen = np.nonzero(is_known[rows])[1].reshape(len(rows), count)
            shift[rows] = self._alike(rows, columns[rows], seen, results)
        self._fill_births(results, columns, shift)
        return assignments.gaining(**vars(results))

    def _alike(self, rows: Index, columns: Index, seen: Index, result: _Results) -> Array:
        """Evaluate the assignments ``rows`` (G,), of ``columns`` (G, D), whose ``seen`` (G, n) are of known objects.

        Returns the shifts (G, r) of the robot; objects that detections start are not filled in.
        """
        objects = np.take_along_axis(columns, seen, axis=1)
        places, after = self._prior(objects)
        shift = np.zeros(places.shape)
        if seen.shape[1]:
            joint = self._together(seen, places, after, *self._system(seen, objects))
            choices = self._choices(joint)
            covariance = joint.covariance if choices is None else choices.covariance
            inverse, (_, log_determinant) = np.asarray(np.linalg.inv(covariance)), np.linalg.slogdet(covariance)
            weighted = (inverse @ joint.residual[..., None])[..., 0]
            shift = -(weighted[:, None] @ joint.cross)[:, 0]
            after = after - _transposed(joint.cross) @ inverse @ joint.cross
            squared = (joint.residual * weighted).sum(axis=1)
            degrees = np.count_nonzero(joint.jacobian.any(axis=2), axis=1)
            log_normaliser = joint.log_normalisers.sum(axis=1)
            result.log_evidence[rows] = log_normaliser - 0.5 * squared - 0.5 * log_determinant
            if choices is not None:
                result.log_evidence[rows] = log_normaliser + choices.log_density
                result.outlier[rows[:, None], seen] = choices.outlier
                result.outlier_probability[rows[:, None], seen] = choices.probability
            result.innovation_nees[rows] = squared / degrees
            if self.errors is not None and len(self._sensor[0]):
                self._fill_sensor(result, rows, self._with_sensor(self.errors, joint, seen, places), inverse, joint)
            change = (joint.jacobian @ shift[..., None])[..., 0]
            variances = np.diagonal(joint.covariance, axis1=1, axis2=2) - 1.0
            result.bend[rows] = self._bend(seen, *self._from_where_linear(seen, objects, change, variances))
        own = np.concatenate([np.zeros((len(rows), 1), dtype=int), 1 + objects], axis=1)
        self._fill(result, rows, seen, own, self.layout.blocks(shift), after)
        return shift[:, self.layout.block(0)]

    @staticmethod
    def _with_sensor(errors: PredictedErrors, joint: JointInnovation, seen: Index, places: Index) -> Array:
        """(G, m, d) covariance of the residuals of detections ``seen`` (G, n) with the constant sensor errors."""
        rows, sensor = _components(seen), slice(len(errors.transition.by_sensor), None)
        repeated = errors.slopes.ravel()[rows][..., None] * errors.covariance[rows, sensor]
        return np.asarray(joint.jacobian @ errors.cross[places, sensor] + repeated)

    def _fill_sensor(self, result: _Results, rows: Index, cross: Array, inverse: Array, joint: JointInnovation) -> None:
        """Update the constant sensor errors, by their covariance ``cross`` (G, m, d) with the residuals."""
        gain = _transposed(cross) @ inverse
        result.sensor[rows] -= (gain @ joint.residual[..., None])[..., 0]
        with_robot = joint.cross[..., self.layout.block(0)]
        result.sensor_covariance[rows] -= gain @ np.concatenate([with_robot, cross], axis=2)

    def _choices(self, joint: JointInnovation) -> OutlierChoices | None:
        """Which detections are outliers; None: none can be."""
        if self.tail is None:
            return None
        return OutlierChoices.of(self.tail, joint.residual, joint.covariance, joint.measured)

    def innovation(self, columns: Index, seen: list[int]) -> JointInnovation:
        """Joint innovation of the detections ``seen``; ``columns`` (D,): the object of each detection."""
        numbers = np.array(seen, dtype=int)
        objects = columns[numbers][None]
        return _first(self._together(numbers[None], *self._prior(objects), *self._system(numbers[None], objects)))

    def innovation_of_pairs(self, numbers: Index, objects: Index) -> JointInnovation:
        """Joint innovation of detections ``numbers`` (P,), each as one of ``objects`` (P,).

        Pairs may share a detection or an object, which then occurs once among the states. White errors are independent
        between pairs.
        """
        every, place = np.unique(objects, return_inverse=True)
        part, seen, layout = self._part, numbers[None], self.layout
        residual = part.residual[seen, objects]
        jacobian = np.zeros((len(numbers), residual.shape[-1], layout.size(len(every))))
        jacobian[..., layout.block(0)] = part.jacobian_robot[numbers, objects]
        for number in range(len(every)):
            pairs = place == number
            jacobian[pairs, :, layout.block(1 + number)] = part.jacobian_object[numbers[pairs], objects[pairs]]
        stacked = jacobian.reshape(1, -1, layout.size(len(every)))
        system = residual.reshape(1, -1), stacked, part.log_normaliser[seen, objects]
        return _first(self._together(seen, *self._prior(every[None]), *system))

    def _together(
        self, seen: Index, places: Index, prior: Array, residual: Array, jacobian: Array, log_normalisers: Array
    ) -> JointInnovation:
        """Detections ``seen`` (G, n) with Jacobians (G, m, k) by the states at ``places`` (G, k), of ``prior``."""
        cross = jacobian @ prior
        covariance = cross @ _transposed(jacobian)
        if self.errors is not None:
            repeated = self._repeated(self.errors, seen, places)
            cross += _transposed(repeated)
            both = jacobian @ repeated
            covariance += both + _transposed(both) + self._repeated_noise(self.errors, seen)
        diagonal = np.arange(residual.shape[1])
        covariance[:, diagonal, diagonal] += 1.0
        return JointInnovation(residual, jacobian, cross, covariance, log_normalisers)

    def _prior(self, objects: Index) -> tuple[Index, Array]:
        """(G, k) rows of the robot and of objects (G, n), and their (G, k, k) predicted covariances."""
        places = self.layout.rows_of_slots(
            np.concatenate([np.zeros((len(objects), 1), dtype=int), 1 + objects], axis=1)
        )
        return places, self.covariance[places[:, :, None], places[:, None, :]]

    @staticmethod
    def _repeated(errors: PredictedErrors, seen: Index, places: Index) -> Array:
        """(G, p, m) covariance of the states at ``places`` (G, p) with the correlated part of the residuals."""
        rows = _components(seen)
        return np.asarray(errors.cross[places[:, :, None], rows[:, None]] * errors.slopes.ravel()[rows][:, None])

    @staticmethod
    def _repeated_noise(errors: PredictedErrors, seen: Index) -> Array:
        """(G, m, m) covariance of the correlated part of the residuals."""
        rows = _components(seen)
        slopes = errors.slopes.ravel()[rows]
        return np.asarray(slopes[:, :, None] * errors.covariance[rows[:, :, None], rows[:, None]] * slopes[:, None])

    def _system(self, seen: Index, objects: Index) -> tuple[Array, Array, Array]:
        """Whitened residuals (G, m), their Jacobians by robot and objects in turn, and (G, n) log normalisers."""
        part, (count, n) = self._part, seen.shape
        residual = part.residual[seen, objects]
        size = residual.shape[-1]
        jacobian = np.zeros((count, n, size, self.layout.size(n)))
        jacobian[..., self.layout.block(0)] = part.jacobian_robot[seen, objects]
        by_object = part.jacobian_object[seen, objects]
        for place in range(n):
            jacobian[:, place, :, self.layout.block(1 + place)] = by_object[:, place]
        stacked = jacobian.reshape(count, n * size, self.layout.size(n))
        return residual.reshape(count, -1), stacked, part.log_normaliser[seen, objects]

    def _from_where_linear(self, seen: Index, objects: Index, change: Array, variances: Array) -> tuple[Array, Array]:
        """Changes (G, m) relative to the linearisation points, and (G, m) variances that remain there.

        Several pairs, linearised each at its own mode, say nothing of their joint one: that is searched, unless the
        range of one of their objects is poorly known.
        """
        if self._pairs.offsets is None or self._pairs.elsewhere is None:
            return change, variances
        if self._pairs.at_prediction is not None and seen.shape[1] > 1:
            return change, variances
        offsets, elsewhere = self._pairs.offsets[seen, objects], self._pairs.elsewhere[seen, objects]
        widths = np.where(elsewhere[..., None], np.minimum(variances.reshape(offsets.shape), 1.0), np.inf)
        return change - offsets.reshape(change.shape), np.minimum(variances, widths.reshape(change.shape))

    def _bend(self, seen: Index, change: Array, variances: Array) -> Array:
        """(G,) nonlinearity: a direction that turns by a = sigma c has a second-order term of a^2 / 2 of its distance.

        ``change`` (G, m) of the whitened measurements from prediction to mode, and ``variances`` of the prediction.
        """
        squared = np.maximum(change**2, variances).reshape(*seen.shape, -1).sum(axis=2)
        return np.asarray((0.5 * self.turns[seen] * squared).max(axis=1))

    def _fill(self, result: _Results, rows: Index, seen: Index, own: Index, shift: Array, after: Array) -> None:
        """Fill in states and covariances at the modes, in the tangent spaces of the prediction, as shifts are small."""
        robot, storage, at = self.layout.block(0), self.spaces.storage, (rows[:, None], seen)
        states = self._retracted(own, shift)
        result.robot[rows], result.robot_covariance[rows] = states[:, 0, : storage.robot], after[:, robot, robot]
        result.object_states[at] = states[:, 1:, : storage.landmark]
        blocks = self.layout.size(0) + np.arange(seen.shape[1] * self.layout.landmark).reshape(-1, self.layout.landmark)
        result.object_covariances[at] = after[:, blocks[:, :, None], blocks[:, None, :]]
        result.object_crosses[at] = np.swapaxes(after[:, robot, blocks], 1, 2)

    def _fill_births(self, result: _Results, columns: Index, shift: Array) -> None:
        """Fill in the objects that detections start, of ``columns`` (K, D), by the robot's ``shift`` (K, r)."""
        numbers, rows = np.nonzero((columns >= self.known).T)
        if not len(rows):
            return
        around, mean = result.robot_covariance[rows], np.array([born.prior.mean for born in self.births])[numbers]
        gain = np.array([born.gain for born in self.births])[numbers]
        noise = np.array([born.noise for born in self.births])[numbers]
        result.object_states[rows, numbers] = self.spaces.landmark.retract(mean, (gain @ shift[rows, :, None])[..., 0])
        result.object_covariances[rows, numbers] = gain @ around @ _transposed(gain) + noise
        result.object_crosses[rows, numbers] = around @ _transposed(gain)
        np.add.at(result.log_evidence, rows, np.array([born.log_stand_in for born in self.births])[numbers])

    def _retracted(self, own: Index, shift: Array) -> Array:
        """(G, 1 + n, s) states of a robot and n objects, rows ``own`` (G, 1 + n), moved by (G, 1 + n, w)."""
        states = self.spaces.joint.retract(self.mean[own], shift)
        if self._anchors is None or own.shape[1] < 2:
            return states
        anchors = self._anchors[own[:, 1:] - 1]
        far, space = np.isfinite(anchors).all(axis=-1), self.spaces.landmark
        before = self.mean[own[:, 1:]][far][:, : space.storage_size]
        along = space.position_slopes(before) @ shift[:, 1:, : space.tangent_size][far][..., None]
        places = moved(anchors[far], space.position(before), along[..., 0])
        states[:, 1:, : places.shape[1]][far] = places
        return states


def _first(joint: JointInnovation) -> JointInnovation:
    """The joint innovation of the first assignment."""
    return JointInnovation(*(values[0] for values in vars(joint).values()))


def _transposed(matrices: Array) -> Array:
    return np.swapaxes(matrices, -1, -2)


def _components(seen: Index) -> Index:
    """(G, 2 n) error components of detections (G, n)."""
    return np.asarray((2 * seen[:, :, None] + np.arange(2)).reshape(len(seen), -1))
