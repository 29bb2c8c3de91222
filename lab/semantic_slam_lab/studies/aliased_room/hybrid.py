"""GTSAM's HybridSmoother in a room without a map, as near as it comes to the other methods.

It has discrete variables for associations, but no births and no existence. Here the front end gives it both: a
detection that no known landmark is near starts one; of others a discrete variable says which landmark near it it is of,
or of none. The existence of landmarks follows from its best associations by the same probabilities as everywhere.
All options of a variable need the same keys, so that each factor holds all landmarks near and ignores those not meant.
"""

import time
from dataclasses import dataclass, field

import gtsam
import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector, wrap_angle
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.open_world.existence import LEAST_DETECTION_SHARE, birth, existence_after_miss
from semantic_slam.inference.open_world.planar.detection_probability import undetected_share
from semantic_slam.inference.open_world.planar.region import sensor_region
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam_lab.studies.aliased_room.data import Rates, Recording
from semantic_slam_lab.studies.aliased_room.methods import START_SIGMA, Outcome, front_end

MARGINAL_THRESHOLD = 0.99
"""Probability from which on HybridSmoother fixes a discrete variable."""
MAX_LEAVES = 10
FAR_M = 3.0
"""Along and across the line of sight: beyond it no landmark is looked at."""
MAX_OPTIONS = 3
"""Landmarks that a detection may be of at most, besides none."""
NONE = -1


@dataclass
class _Landmark:
    existence: float
    alive: bool = True


@dataclass(frozen=True)
class _Sighting:
    """A detection: the landmarks it may be of, and its discrete variable, None where it started a landmark."""

    k: int
    polar: Array  # (2,)
    options: tuple[int, ...]
    choice: int | None


@dataclass
class _Map:
    """The growing problem; ``plain`` holds what does not depend on associations."""

    smoother: gtsam.HybridSmoother
    plain: gtsam.NonlinearFactorGraph = field(default_factory=gtsam.NonlinearFactorGraph)
    values: gtsam.Values = field(default_factory=gtsam.Values)
    landmarks: list[_Landmark] = field(default_factory=list)
    sightings: list[list[_Sighting]] = field(default_factory=list)


class HybridDrive:
    """Takes keyframes one by one."""

    def __init__(self, start: Array, alarms: float, misses: float) -> None:
        self._settings = front_end(alarms, misses)
        self._region = sensor_region(self._settings)
        self._map = _Map(gtsam.HybridSmoother(MARGINAL_THRESHOLD))
        prior = gtsam.noiseModel.Diagonal.Sigmas(np.array(START_SIGMA))
        self._start = gtsam.PriorFactorPose2(_robot(0), gtsam.Pose2(*start), prior)
        self._first = start

    def take(self, keyframe: Keyframe) -> tuple[Array, Array]:
        """(3,) robot and (3, 3) covariance along the axes of map after one keyframe."""
        k, known = keyframe.index, self._map
        graph, values = gtsam.HybridNonlinearFactorGraph(), gtsam.Values()
        robot = self._moved(keyframe, graph, values)
        before = self._map.values
        predicted = gtsam.Values(before)
        predicted.insert(_robot(k), gtsam.Pose2(*robot))
        marginals = gtsam.Marginals(known.plain, predicted)
        self._updated(graph, values)
        known.sightings.append([])
        for row in range(len(keyframe.measurements)):  # one by one: together their options multiply before pruning
            graph, values = gtsam.HybridNonlinearFactorGraph(), gtsam.Values()
            seen = self._sighting(k, row, keyframe.measurements, predicted, marginals, graph, values)
            known.sightings[k].append(seen)
            self._updated(graph, values)
        found = known.smoother.optimize()
        self._start_unassigned(k, keyframe.measurements, found)
        chosen = self.associations()
        self._account(k, chosen[k])
        full = self._resolved(chosen)
        known.values = gtsam.LevenbergMarquardtOptimizer(full, known.values).optimize()
        pose = _pose(known.values, k)
        spread = gtsam.Marginals(full, known.values).marginalCovariance(_robot(k))
        return pose, se2.rotate_covariance(pose, spread)

    def associations(self) -> list[tuple[int, ...]]:
        """The best landmark of every detection; of none: -1."""
        estimate = self._map.smoother.optimize() if self._map.sightings else None
        return [tuple(_chosen(item, estimate) for item in own) for own in self._map.sightings]

    def outcome(self, seconds: Array, filtered: Array, covariances: Array, fault: str) -> Outcome:
        """The state now, as of the other methods; it knows no classes."""
        known = self._map
        alive = [n for n, landmark in enumerate(known.landmarks) if landmark.alive]
        return Outcome(
            method="hybrid_smoother",
            associations=self.associations(),
            poses=np.array([_pose(known.values, k) for k in range(len(known.sightings))]),
            filtered=filtered,
            covariances=covariances,
            object_ids=np.array(alive, dtype=int),
            objects=np.array([known.values.atPoint2(_object(n)) for n in alive]).reshape(-1, 2),
            existence=np.array([known.landmarks[n].existence for n in alive]),
            class_names=(),
            classes=np.zeros((len(alive), 0)),
            seconds=seconds,
            hypotheses=np.full(len(known.sightings), MAX_LEAVES),
            discarded_mass=float("nan"),
            fault=fault,
        )

    def _moved(self, keyframe: Keyframe, graph: gtsam.HybridNonlinearFactorGraph, values: gtsam.Values) -> Array:
        k, known = keyframe.index, self._map
        if k == 0:
            graph.push_back(self._start)
            known.plain.add(self._start)
            values.insert(_robot(0), gtsam.Pose2(*self._first))
            return self._first
        control = planar_from_pose_vector(keyframe.odometry)
        noise = gtsam.noiseModel.Gaussian.Covariance(planar_from_covariance(keyframe.odometry_covariance))
        factor = gtsam.BetweenFactorPose2(_robot(k - 1), _robot(k), gtsam.Pose2(*control), noise)
        graph.push_back(factor)
        known.plain.add(factor)
        robot = se2.compose(_pose(known.values, k - 1), control)
        values.insert(_robot(k), gtsam.Pose2(*robot))
        return np.asarray(robot)

    def _sighting(
        self,
        k: int,
        row: int,
        seen: SemanticMeasurements,
        predicted: gtsam.Values,
        marginals: gtsam.Marginals,
        graph: gtsam.HybridNonlinearFactorGraph,
        values: gtsam.Values,
    ) -> _Sighting:
        polar = np.array([seen.ranges_m[row], seen.bearings_rad[row]])
        noise = seen.geometric_covariances[row]
        near = self._near(k, polar, noise, predicted, marginals)
        if not near:
            number = self._born(k, polar, noise, predicted, values)
            graph.push_back(_factor(k, number, polar, noise))
            return _Sighting(k, polar, (number,), None)
        choice = int(gtsam.symbol("b", 100 * k + row))
        peak = 0.5 * np.linalg.slogdet(2.0 * np.pi * noise)[1]
        options = [(self._option(k, near, n, polar, noise), peak - self._log_ratio(n, k, predicted)) for n in near]
        intensity, _ = self._new(predicted, k, polar)
        options.append((self._option(k, near, NONE, polar, noise), -float(np.log(intensity * polar[0]))))
        graph.push_back(gtsam.HybridNonlinearFactor((choice, len(options)), options))
        return _Sighting(k, polar, (*near, NONE), choice)

    def _near(
        self, k: int, polar: Array, noise: Array, predicted: gtsam.Values, marginals: gtsam.Marginals
    ) -> tuple[int, ...]:
        """Landmarks inside the gate, nearest first."""
        found = []
        for n, landmark in enumerate(self._map.landmarks):
            if landmark.alive and predicted.exists(_object(n)):
                residual, by_robot, by_object = _linearised(predicted, k, n, polar)
                if np.abs(residual[0]) > FAR_M or np.abs(residual[1]) * polar[0] > FAR_M:
                    continue
                joint = marginals.jointMarginalCovariance([_robot(k), _object(n)]).fullMatrix()
                jacobian = np.hstack([by_robot, by_object])
                squared = residual @ np.linalg.solve(jacobian @ joint @ jacobian.T + noise, residual)
                if squared < self._settings.gate_sigma**2:
                    found.append((float(squared), n))
        return tuple(n for _, n in sorted(found)[:MAX_OPTIONS])

    def _born(self, k: int, polar: Array, noise: Array, predicted: gtsam.Values, values: gtsam.Values) -> int:
        number = len(self._map.landmarks)
        place = _pose(predicted, k)
        angle = place[2] + polar[1]
        point = place[:2] + polar[0] * np.array([np.cos(angle), np.sin(angle)])
        self._map.landmarks.append(_Landmark(float(self._new(predicted, k, polar)[1])))
        self._map.plain.add(_factor(k, number, polar, noise))
        values.insert(_object(number), point)
        return number

    def _new(self, predicted: gtsam.Values, k: int, polar: Array) -> tuple[float, float]:
        """Intensity of a first detection, and existence of what it is of."""
        x, clutter = _pose(predicted, k), self._settings.clutter_per_frame / self._region.area_m2
        angle = x[2] + polar[1]
        point = x[:2] + polar[0] * np.array([np.cos(angle), np.sin(angle)])
        trail = np.array([_pose(predicted, n) for n in range(k)]).reshape(-1, 3)
        unseen = undetected_share(self._region, DetectionRates.of(self._settings), trail, point[None])[0, 0]
        density = self._settings.birth_density * max(unseen, self._settings.least_undetected_share)
        intensity, existence = birth(self._settings.detection_probability * density, clutter)
        return float(intensity), float(existence)

    def _log_ratio(self, n: int, k: int, predicted: gtsam.Values) -> float:
        r, detected = self._map.landmarks[n].existence, self._detected(n, k, predicted, [])
        least = LEAST_DETECTION_SHARE * self._settings.detection_probability
        return float(np.log(r * max(detected, least)) - np.log1p(-min(r * detected, 1.0 - 1e-9)))

    def _detected(self, n: int, k: int, values: gtsam.Values, seen: list[Array]) -> float:
        relative = se2.between(_pose(values, k), np.append(values.atPoint2(_object(n)), 0.0))[:2]
        polar = np.array(seen).reshape(-1, 2)
        inside = self._region.contains(relative, 0.01 * np.eye(2))
        hidden = self._region.not_occluded(relative, polar[:, 0], polar[:, 1])
        return float(self._settings.detection_probability * inside * hidden)

    def _option(self, k: int, near: tuple[int, ...], meant: int, polar: Array, noise: Array) -> gtsam.NoiseModelFactor:
        """Range and bearing of landmark ``meant``, which ignores the others; of none: nothing."""

        def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
            if jacobians is not None:
                jacobians[0] = np.zeros((2, 3))
                for place in range(len(near)):
                    jacobians[1 + place] = np.zeros((2, 2))
            if meant == NONE:
                return np.zeros(2)
            residual, by_robot, by_object = _linearised(values, k, meant, polar)
            if jacobians is not None:
                jacobians[0], jacobians[1 + near.index(meant)] = by_robot, by_object
            return residual

        model = gtsam.noiseModel.Gaussian.Covariance(noise)
        return gtsam.CustomFactor(model, [_robot(k), *(_object(n) for n in near)], error)

    def _updated(self, graph: gtsam.HybridNonlinearFactorGraph, values: gtsam.Values) -> None:
        smoother, known = self._map.smoother, self._map
        initial = gtsam.Values(smoother.linearizationPoint())
        initial.insert(values)
        smoother.update(graph, initial, MAX_LEAVES)
        for key in values.keys():  # noqa: SIM118
            _copy(values, known.values, key)

    def _start_unassigned(self, k: int, seen: SemanticMeasurements, estimate: gtsam.HybridValues) -> None:
        """A detection that is best of none starts a landmark after all."""
        graph, values = gtsam.HybridNonlinearFactorGraph(), gtsam.Values()
        for row, item in enumerate(self._map.sightings[k]):
            if item.choice is not None and _chosen(item, estimate) == NONE:
                noise = seen.geometric_covariances[row]
                number = self._born(k, item.polar, noise, self._map.values, values)
                graph.push_back(_factor(k, number, item.polar, noise))
                self._map.sightings[k][row] = _Sighting(k, item.polar, (number,), None)
        if values.size():
            self._updated(graph, values)

    def _account(self, k: int, chosen: tuple[int, ...]) -> None:
        """Existence after the keyframe, under the best associations."""
        polar = [item.polar for item in self._map.sightings[k]]
        for n, landmark in enumerate(self._map.landmarks):
            is_new = any(item.choice is None and item.options == (n,) for item in self._map.sightings[k])
            if not landmark.alive or is_new:
                continue
            if n in chosen:
                landmark.existence = 1.0
                continue
            detected = self._detected(n, k, self._map.values, polar)
            landmark.existence = float(existence_after_miss(np.array(landmark.existence), np.array(detected)))
            landmark.alive = landmark.existence >= self._settings.least_existence

    def _resolved(self, chosen: list[tuple[int, ...]]) -> gtsam.NonlinearFactorGraph:
        """The graph of the best associations."""
        graph = gtsam.NonlinearFactorGraph(self._map.plain)
        for own, numbers in zip(self._map.sightings, chosen, strict=True):
            for item, n in zip(own, numbers, strict=True):
                if item.choice is not None and n != NONE:
                    graph.add(_factor(item.k, n, item.polar, NOISE))
        return graph


NOISE = np.diag([0.1, 0.03]) ** 2
"""Covariance of range and bearing that perception states."""


def drive_with_hybrid_smoother(drive: Recording, rates: Rates, alarms: float) -> Outcome:
    """All keyframes; a run that fails ends early and says so."""
    solver = HybridDrive(drive.truth[0], alarms, rates.misses)
    seconds, poses, covariances, fault = [], [], [], ""
    for keyframe in drive.keyframes:
        begin = time.thread_time()
        try:
            pose, covariance = solver.take(keyframe)
        except (RuntimeError, IndexError, ValueError) as error:
            fault = f"keyframe {keyframe.index}: {str(error).splitlines()[0]}"
            break
        seconds.append(time.thread_time() - begin)
        poses.append(pose)
        covariances.append(covariance)
    return solver.outcome(np.array(seconds), np.array(poses), np.array(covariances), fault)


def _chosen(item: _Sighting, estimate: gtsam.HybridValues | None) -> int:
    if item.choice is None:
        return item.options[0]
    assert estimate is not None  # where there are choices there is an estimate of them
    return item.options[estimate.atDiscrete(item.choice)]


def _factor(k: int, n: int, polar: Array, noise: Array) -> gtsam.NonlinearFactor:
    model = gtsam.noiseModel.Gaussian.Covariance(noise[::-1, ::-1].copy())
    return gtsam.BearingRangeFactor2D(_robot(k), _object(n), gtsam.Rot2(polar[1]), polar[0], model)


def _linearised(values: gtsam.Values, k: int, n: int, polar: Array) -> tuple[Array, Array, Array]:
    """(2,) residual of [range, bearing], and its (2, 3) and (2, 2) derivatives by robot and landmark."""
    x, point = _pose(values, k), values.atPoint2(_object(n))
    c, s = np.cos(x[2]), np.sin(x[2])
    back = np.array([[c, s], [-s, c]])
    body = back @ (point - x[:2])
    reach = max(float(np.hypot(*body)), 1e-6)
    by_body = np.array([body / reach, np.array([-body[1], body[0]]) / reach**2])
    by_pose = np.array([[-1.0, 0.0, body[1]], [0.0, -1.0, -body[0]]])
    residual = np.array([reach - polar[0], float(wrap_angle(np.arctan2(body[1], body[0]) - polar[1]))])
    return residual, by_body @ by_pose, by_body @ back


def _pose(values: gtsam.Values, k: int) -> Array:
    pose = values.atPose2(_robot(k))
    return np.array([pose.x(), pose.y(), pose.theta()])


def _copy(source: gtsam.Values, target: gtsam.Values, key: int) -> None:
    if chr(gtsam.Symbol(key).chr()) == "x":
        target.insert(key, source.atPose2(key))
    else:
        target.insert(key, source.atPoint2(key))


def _robot(k: int) -> int:
    return int(gtsam.symbol("x", k))


def _object(n: int) -> int:
    return int(gtsam.symbol("o", n))
