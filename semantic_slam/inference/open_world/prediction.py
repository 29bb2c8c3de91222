"""What one hypothesis expects of a keyframe: the robot, the objects that detections may be of, and births."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration, OpenWorldConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Index, broadcast_copy
from semantic_slam.geometry.moments import position_sigmas
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.association.gating import PairDensities
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.correlated_errors import ErrorTransition, PredictedErrors
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.odometry_bias import with_changed_bias
from semantic_slam.inference.models.planar_observation import object_in_body
from semantic_slam.inference.models.sensed_region import SensedRegion
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.open_world.births import Birth, birth_of
from semantic_slam.inference.open_world.detection_probability import (
    PredictedObjects,
    predicted_detection_probabilities,
)
from semantic_slam.inference.open_world.existence import birth, missed
from semantic_slam.inference.open_world.moving_objects import PredictedMovers, RobotMotion, predicted_movers
from semantic_slam.inference.open_world.sensor_region import SensorRegion
from semantic_slam.inference.open_world.unseen_ground import first_detections
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.local_map import LARGEST_AGE, LocalDetection, LocalMap, LocalStart
from semantic_slam.inference.smoothing.tracking import carried_keys
from semantic_slam.inference.states.carried_errors import CarriedErrors
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M
from semantic_slam.inference.states.tracked_objects import TrackedStates

LOST_SIGMA_M, LOST_SIGMA_RAD = 3.0, 0.15
"""Standard deviations of the predicted robot from which on it counts as lost."""
LOCAL_OBJECTS = 40
"""Objects that a local map holds from the start besides those near the detections: amid these and the robot."""
MOST_AHEAD = 80
"""Objects where the sensor looks that it holds besides: any of them may be detected before it is read again."""
AHEAD_RAD = 0.2
"""Beyond the region's bearings, where a turn of the robot brings them into it."""
LEAST_IN_SIGHT = 0.02
"""Share of first detections left where something stands before them: what stands there may be a false alarm."""
HIDES = 0.5
"""Existence above which an object counts as hiding what is behind it."""


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """One parent before the detections: M objects near them, N within reach of the sensor."""

    component: Component
    near: Index  # (M,) rows of the population whose covariance with the robot is known
    predicted: PredictedBelief  # of one parent: robot and near objects
    local: LocalMap  # predicted, holds all near objects
    errors: PredictedErrors | None  # of the detections, where they repeat
    carried_errors: CarriedErrors | None  # of earlier detections, as the motion leaves them
    births: list[Birth]  # D
    rates: DetectionRates  # G settings, given which all below is
    log_intensity: Array  # (D, G) [1/m^2] or, for a bearing alone, in the region
    birth_existence: Array  # (D, G)
    expected_births: Array  # (G,) first detections
    log_beyond: Array  # (D,) bound on the evidence of being of an object that is near but one too many
    in_reach: Index  # (N,) rows of the population that may be in the region
    objects: PredictedObjects  # of those
    detections: Sequence[Any]  # D, with the covariances that the hypothesis takes them to have
    region: SensorRegion
    detected: Array  # (O, G) detection probabilities at the prediction, nothing being hidden
    detectable: Array | None  # (O, G) probability that an object can be detected at all, where misses come in runs
    movers: PredictedMovers | None = None  # objects that move, or may; None: nothing does

    @cached_property
    def stands(self) -> Array:
        """(O, G) probability that the parent's objects stand still, if they exist."""
        stands = np.ones(self.existence.shape)
        if self.movers is not None:
            stands[self.undecided] -= self.movers.movers.moving[~self.movers.movers.decided]
        return stands

    @cached_property
    def undecided(self) -> Index:
        """(u,) rows of the objects that may move, in the order of their ids."""
        assert self.movers is not None
        own = self.movers.movers
        return self.component.objects.rows(own.ids[~own.decided])

    def detected_at_all(self, detected: Array) -> Array:
        """(K, O, G) detection probabilities of objects that stand still or move, from those if they stand still."""
        if self.movers is None:
            return detected
        mixed = detected * self.stands
        own = self.movers.movers
        mixed[:, self.undecided] += (own.moving * self.movers.detected)[~own.decided]
        return mixed

    @property
    def existence(self) -> Array:
        """(O, G) of the parent's objects before the keyframe."""
        return self.component.objects.existence_given

    @property
    def near_ids(self) -> Index:
        """(M,) ids of the objects near the detections, ascending."""
        return self.component.objects.ids[self.near]

    @property
    def is_lost(self) -> bool:
        """Whether the prediction does not tell what is in sight."""
        spread = self.objects.robot_covariance
        far = float(position_sigmas(spread[None])[0]) > LOST_SIGMA_M
        return far or float(spread[2, 2]) > LOST_SIGMA_RAD**2

    @property
    def mover_ids(self) -> Index:
        """(T,) ids of the objects that move, or may."""
        return np.zeros(0, dtype=int) if self.movers is None else self.movers.movers.ids

    def local_after(
        self, pairs: PairDensities, association: Sequence[tuple[int, int]], births: Collection[int]
    ) -> LocalMap:
        """The local map with the detections of one continuation, with the objects that stand still, and that it starts.

        ``association``: detection and object.
        """
        seen = []
        for number, object_id in association:
            if object_id not in births:
                part, column = pairs.parts[number], int(np.searchsorted(self.near_ids, object_id))
                slopes = part.jacobian_robot[column], part.jacobian_object[column], self._residual_by_errors(number)
                seen.append(LocalDetection(object_id, *slopes))
        started = [
            LocalStart(object_id, own.prior.mean, own.gain, *self._place_by_errors(number, own))
            for number, object_id, own in ((n, of, self.births[n]) for n, of in association if of in births)
        ]
        return self.local.updated(seen).with_new(started)

    def _residual_by_errors(self, number: int) -> Array:
        """(2, q) slope of a detection's whitened residual by the errors that repeat."""
        slope = np.zeros((2, self.local.num_errors))
        if self.errors is not None:
            slope[:, 2 * number : 2 * number + 2] = np.diag(self.errors.slopes[number])
        return slope

    def _place_by_errors(self, number: int, born: Birth) -> tuple[Array, Array]:
        """(3, 3) covariance of a new object's place that does not repeat, and (3, q) its slope by what does."""
        slope = np.zeros((3, self.local.num_errors))
        if self.errors is None:
            return born.noise, slope
        share = self.errors.transition.white.settings.correlated_share
        slope[:, 2 * number : 2 * number + 2] = np.sqrt(share) * born.by_error
        return born.noise - share * born.by_error @ born.by_error.T, slope


class Predictor:
    """Predicts; a pure function of the component and the keyframe."""

    def __init__(
        self,
        model: ObservationModel,
        settings: OpenWorldConfiguration,
        errors: DetectionErrorsConfiguration,
        moving: Moving | None = None,
    ):
        self.model, self.settings, self.errors = model, settings, errors
        self._moving = moving or Moving()
        self._region = sensor_region(settings)

    def predict(
        self,
        component: Component,
        motion: Motion,
        detections: Sequence[Any],
        sensed: SensedRegion | None = None,
        named: Index | None = None,
        *,
        stamp_ns: int = 0,
        labels: Sequence[str] = (),
    ) -> Prediction:
        """Under the noises that the component takes robot and sensor to have. Raises LostComponentError.

        ``sensed``: the sensor's region where it is learned. ``named``: (M,) rows of the objects that the detections may
        be of; None: of those near them. ``stamp_ns`` and the detections' ``labels`` matter where objects move.
        """
        motion, space, tracked = component.moved_by(motion), component.spaces.robot, _tracked(component)
        region, rates = self._region.reaching(sensed), component.objects.rates
        control = _control(component, motion)
        robot = space.compose(tracked.robot, control)
        transition = space.propagation(control)
        if motion.by_bias is not None:
            transition = np.concatenate([transition, motion.by_bias], axis=1)
        before = with_changed_bias(tracked.motion_covariance, component.keyframe + 1, len(tracked.bias))
        before = before[: transition.shape[1], : transition.shape[1]]
        spread = transition @ before @ transition.T + motion.covariance
        births = [birth_of(self.model, detection, robot, region.field_of_view_rad) for detection in detections]
        sigma = float(position_sigmas(spread[None])[0])
        margin = self.settings.gate_sigma * np.hypot(sigma, tracked.sigmas)
        reach = np.flatnonzero(_distances(tracked.states, robot) < region.max_range_m + margin)
        if component.elsewhere:
            reach = reach[~np.isin(component.objects.ids[reach], list(component.elsewhere))]
        if named is None:
            near, beyond = self._near(component, robot, spread, births, detections, reach)
        else:
            near, beyond = named, np.full(len(births), -np.inf)
        local = _local(component, robot, near, _ahead(region, tracked.states, robot, reach))
        wider = with_changed_bias(local.covariance, component.keyframe + 1, local.num_biases)
        local = local.moved(robot, wider, transition, motion.covariance)
        carried = None if tracked.errors is None else tracked.errors.moved(motion.control, self.errors)
        local, errors = self._with_errors(local, carried, component.objects.ids[near], detections)
        predicted = _predicted(component, robot, near, local)
        objects = _objects_in_reach(tracked, robot, reach, near, predicted)
        expected, intensity, existence = self._births(component, region, robot, births, detections)
        detected = np.zeros((len(component.objects.ids), len(rates)))
        detected[reach] = predicted_detection_probabilities(region, rates, objects)
        detectable = component.objects.detectable
        if detectable is not None:
            detected *= detectable / rates.runs.share
        movers = None
        if component.movers is not None and (len(component.movers) or self._moving.shares(labels).any()):
            robot_motion = RobotMotion(
                before=tracked.robot,
                after=robot,
                covariance_before=tracked.robot_covariance,
                cross=before[: len(spread)] @ transition.T,
                covariance=spread,
                control=control,
            )
            movers = predicted_movers(
                self._moving,
                component.movers,
                robot_motion,
                stamp_ns,
                region=region,
                rates=rates,
                detections=detections,
                labels=labels,
            )
        return Prediction(
            movers=movers,
            component=component,
            near=near,
            predicted=predicted,
            local=local,
            errors=errors,
            carried_errors=carried,
            births=births,
            rates=rates,
            log_intensity=intensity,
            birth_existence=existence,
            expected_births=expected,
            log_beyond=beyond,
            in_reach=reach,
            objects=objects,
            detected=detected,
            detectable=detectable,
            detections=detections,
            region=region,
        )

    def _with_errors(
        self, local: LocalMap, carried: CarriedErrors | None, near_ids: Index, detections: Sequence[Any]
    ) -> tuple[LocalMap, PredictedErrors | None]:
        """The local map with the errors of these detections in place of earlier ones; as it is without detections."""
        if self.errors.correlated_share <= 0.0 or not detections:
            return local, None
        places = np.array([detection.place for detection in detections])
        ranged = np.array([detection.has_range for detection in detections], dtype=bool)
        transition = ErrorTransition.of(self.errors, carried, places)
        local = local.with_errors(transition.matrix, transition.noise)
        return local, PredictedErrors(
            transition=transition,
            slopes=transition.white.slopes(ranged),
            covariance=local.covariance[local.errors, local.errors],
            cross=local.covariance[local.rows(near_ids), local.errors],
        )

    def _near(
        self,
        component: Component,
        robot: Array,
        spread: Array,
        births: list[Birth],
        detections: Sequence[Any],
        reach: Index,
    ) -> tuple[Index, Array]:
        """(M,) rows of objects that a detection may be of; where objects are few, of all within reach.

        Those that fit best where they are too many, and (D,) a bound on what the others would weigh. Errors of robot
        and object are taken as independent: what they share brings them closer.
        """
        limit, gate = self.settings.max_joint_objects, self.settings.gate_sigma
        objects, tracked = component.objects, _tracked(component)
        if len(objects.ids) <= limit:
            return reach, np.full(len(births), -np.inf)
        away = np.full((len(births), len(objects.ids)), np.inf)
        for own, born, detection in zip(away, births, detections, strict=True):
            own[reach] = _sigmas_away(tracked, robot, spread, born, detection)[reach]
        excess = away.min(axis=0, initial=np.inf)
        order = np.argsort(excess, kind="stable")
        order = order[excess[order] < gate]
        peaks = np.array([detection.log_normaliser for detection in detections])
        detected = objects.existence[order[limit:]] * objects.rates.average(objects.rates.probability)
        weights = -0.5 * away[:, order[limit:]] ** 2 + np.log(detected) - missed(detected, np.ones(len(detected)))[0]
        beyond = peaks + np.logaddexp.reduce(weights, axis=1, initial=-np.inf)
        return np.sort(order[:limit]), np.asarray(beyond)

    def _born_at(self, component: Component, births: list[Birth]) -> tuple[Array, Array]:
        """(D S, 2) points in map that stand for where the objects of detections may be, and their (D, S) weights.

        A region that is learned ends where detections end, whose errors are in it: there the places count as known.
        """
        known = self.settings.learn_region or self.settings.least_undetected_share >= 1.0
        if known or not len(_tracked(component).trail) or not births:
            return np.array([born.prior.mean[:2] for born in births]).reshape(-1, 2), np.ones((len(births), 1))
        places = [_places(born) for born in births]
        return np.concatenate([points for points, _ in places]), np.array([weights for _, weights in places])

    def _births(
        self,
        component: Component,
        region: SensorRegion,
        robot: Array,
        births: list[Birth],
        detections: Sequence[Any],
    ) -> tuple[Array, Array, Array]:
        """(G,) first detections expected from ``robot`` (3,), most of them where it has not looked before.

        (D, G) log intensities of those that the detections may be, and existence of what they are detections of. Behind
        what another detection of the frame shows there is hardly anything but false alarms.
        """
        rates, trail = component.objects.rates, _tracked(component).trail
        points, weights = self._born_at(component, births)
        least, hiding = self.settings.least_undetected_share, _hiding(component)
        expected, at_points = first_detections(region, rates, trail, robot, points, least, hiding)
        found = (at_points.reshape(*weights.shape, len(rates)) * weights[..., None]).sum(axis=1)
        found *= _in_sight(region, detections)[:, None]
        intensity, existence = birth(found, self.settings.clutter_per_frame / region.area_m2)
        ranged = np.array([detection.has_range for detection in detections], dtype=bool)
        return expected, np.log(np.where(ranged[:, None], intensity, intensity * region.area_m2)), existence


def _in_sight(region: SensorRegion, detections: Sequence[Any]) -> Array:
    """(D,) 1 for detections that none of the others stands before, else little."""
    ranges = np.array([detection.range_m for detection in detections], dtype=np.float64)
    bearings = np.array([detection.bearing_rad for detection in detections], dtype=np.float64)
    relative = np.nan_to_num(ranges)[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    return np.maximum(region.not_occluded(relative, ranges, bearings), LEAST_IN_SIGHT)


def _hiding(component: Component) -> Array:
    """(N, 2) places of the objects that rather exist than not, which hide what is behind them."""
    places: Array = _tracked(component).states[component.objects.existence > HIDES, :2]
    return places


def _places(born: Birth) -> tuple[Array, Array]:
    """(S, 2) points in map and their (S,) weights that stand for where a detection's object may be, given the robot."""
    cos, sin = np.cos(born.prior.mean[2]), np.sin(born.prior.mean[2])
    root = np.array([[cos, -sin], [sin, cos]]) @ np.linalg.cholesky(born.noise[:2, :2])
    offsets = np.sqrt(3.0) * np.concatenate([np.zeros((1, 2)), root.T, -root.T])
    return born.prior.mean[:2] + offsets, np.array([1.0 / 3.0, *(1.0 / 6.0,) * 4])


def sensor_region(settings: OpenWorldConfiguration) -> SensorRegion:
    """The region in which a miss counts."""
    return SensorRegion(
        min_range_m=settings.min_range_m,
        max_range_m=settings.max_range_m,
        field_of_view_rad=settings.field_of_view_rad,
        direction_rad=settings.direction_rad,
        occluder_radius_m=settings.occluder_radius_m,
    )


def _ahead(region: SensorRegion, states: Array, robot: Array, reach: Index) -> Index:
    """(n,) rows of the objects of those within ``reach`` (N,) towards which the sensor looks, the nearest ones."""
    apart = states[reach, :2] - robot[:2]
    off = region.off_centre(np.arctan2(apart[:, 1], apart[:, 0]) - robot[2])
    seen = reach[np.abs(off) <= 0.5 * region.field_of_view_rad + AHEAD_RAD]
    return seen[np.argsort(_distances(states[seen], robot), kind="stable")[:MOST_AHEAD]]


def _local(component: Component, robot: Array, near: Index, ahead: Index) -> LocalMap:
    """The joint covariance of the newest robot pose and what is near, from the smoother where it has to be.

    Reading it costs as much as eliminating the whole drive anew: it holds what may be near next, too, ``ahead`` (n,).
    """
    tracked, known = _tracked(component), component.local
    ids = component.objects.ids[near]
    if known is not None and known.age < LARGEST_AGE and known.holds(ids):
        return known
    if component.single_steps:
        amid = robot[:2] if not len(near) else 0.5 * (robot[:2] + tracked.states[near, :2].mean(axis=0))
        around = np.argsort(_distances(tracked.states, amid), kind="stable")[:LOCAL_OBJECTS]
        ids = component.objects.ids[np.union1d(np.union1d(near, ahead), around)]
    keys = carried_keys(component.keyframe, len(tracked.bias), tracked.errors)
    together = tracked.motion_covariance.copy()
    if len(ids):
        together = component.joint_covariance([*keys, *(object_key(int(n)) for n in ids)])
    return LocalMap(
        layout=component.spaces.layout,
        ids=ids,
        robot=tracked.robot,
        objects=tracked.states[component.objects.rows(ids)],
        covariance=together,
        num_biases=len(tracked.bias),
        num_errors=tracked.num_errors,
    )


def _predicted(component: Component, robot: Array, near: Index, local: LocalMap) -> PredictedBelief:
    """b^-[x_k, O] (Eqs. 4.11, 4.21) over the robot and the near objects."""
    spaces = component.spaces
    mean = spaces.storage.stacked(robot[None], _tracked(component).states[near])
    return PredictedBelief(spaces.layout, mean[None], local.of(component.objects.ids[near])[None])


def _objects_in_reach(
    tracked: TrackedStates, robot: Array, reach: Index, near: Index, predicted: PredictedBelief
) -> PredictedObjects:
    """Objects within range given the robot; without a covariance with it at hand they count as moving along."""
    r, landmark = predicted.layout.block(0), slice(predicted.layout.landmark)
    spread = predicted.covariance[0, r, r]
    states = tracked.states[reach]
    gain = se2.adjoint(se2.between(states, broadcast_copy(robot, states.shape)))
    remainder = np.zeros((len(reach), landmark.stop, landmark.stop))
    known = np.searchsorted(reach, near)
    inside = known < len(reach)
    inside[inside] = reach[known[inside]] == near[inside]
    if inside.any():
        blocks = predicted.blocks[0]
        numbers = 1 + np.flatnonzero(inside)
        cross = blocks[numbers, landmark, 0, r]  # (m, l, r) of object with robot
        own = cross @ np.linalg.inv(spread)
        gain[known[inside]] = own
        remainder[known[inside]] = blocks[numbers, landmark, numbers, landmark] - own @ np.swapaxes(cross, 1, 2)
    return PredictedObjects(robot=robot, robot_covariance=spread, objects=states, gain=gain, remainder=remainder)


def _sigmas_away(tracked: TrackedStates, robot: Array, spread: Array, born: Birth, detection: Any) -> Array:
    """(O,) standard deviations between a detection and where each object is predicted; of direction without a range."""
    sigma = float(position_sigmas(spread[None])[0])
    if detection.has_range:
        swing, noise = spread[2, 2] * detection.range_m**2, float(position_sigmas(born.noise[None])[0])
        errors = np.sqrt(sigma**2 + swing + tracked.sigmas**2 + noise**2)
        return np.asarray(_distances(tracked.states, born.prior.mean) / errors)
    body = object_in_body(broadcast_copy(robot, tracked.states.shape), tracked.states) - detection.origin
    distance, bearing = np.hypot(*body.T), np.arctan2(body[:, 1], body[:, 0])
    across = (sigma**2 + tracked.sigmas**2) / np.maximum(distance, LEAST_DISTANCE_M) ** 2
    turn = np.abs(wrap_angle(bearing - detection.bearing_rad))
    return np.asarray(turn / np.sqrt(detection.covariance[1, 1] + spread[2, 2] + across))


def _tracked(component: Component) -> TrackedStates:
    """The states that an open world's components track."""
    assert component.tracked is not None
    return component.tracked


def _control(component: Component, motion: Motion) -> Array:
    """(s,) odometry without what it always gets wrong, as far as that is known."""
    if motion.by_bias is None:
        return motion.control
    return component.spaces.robot.retract(motion.control, motion.by_bias @ _tracked(component).bias)


def _distances(states: Array, point: Array) -> Array:
    """(O,) distances [m] of objects from a point."""
    return np.asarray(np.hypot(states[:, 0] - point[0], states[:, 1] - point[1]))
