"""The Gaussian belief b[X_k] of one hypothesis (Eq. 4.9): its iSAM2, its objects, and all else that it assumes.

A component is forked when its hypothesis branches.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import transport
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.evidence.window import Window
from semantic_slam.inference.models.joint_prior import joint_prior_factors, twin_factors
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.noise.clock_offset import line_at
from semantic_slam.inference.models.noise.noise_settings import NoiseSettings
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.odometry_bias import CLOCK
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.local_map import LocalMap
from semantic_slam.inference.smoothing.past.marginalisation import without_past
from semantic_slam.inference.smoothing.semantic_factors import SemanticFactorMaker
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.smoothing.tracking import tracked_after, tracked_again
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior, JointPrior
from semantic_slam.inference.states.keys import number_of, object_key, robot_key
from semantic_slam.inference.states.metre import Metre
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.inference.states.observers import Observers
from semantic_slam.inference.states.outlier_counts import OutlierCounts
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import HypothesisObjects, TrackedStates


@dataclass(frozen=True, kw_only=True)
class Component:
    """A hypothesis's smoother, its objects and what it assumes; an only child may consume its parent's smoother."""

    spaces: Spaces
    model: ObservationModel
    smoother: Smoother
    objects: HypothesisObjects
    keyframe: int = -1  # index of the newest; -1 before the first
    classes: dict[int, int] = field(default_factory=dict)  # object id -> enumerated class
    views: dict[int, ObjectViews] = field(default_factory=dict)  # object id -> record of its semantic views
    robot_correction: Correction | None = None  # of the newest robot pose, by semantics without a factor
    window: Window | None = None  # since it was last Gaussian; None: it is Gaussian now
    corrections: dict[int, Correction] = field(default_factory=dict)  # GTSAM key -> moment correction of its Gaussian
    tracked: TrackedStates | None = None  # None: marginals are read from the smoother on demand
    single_steps: bool = False  # one update per keyframe, not iterated
    local: LocalMap | None = None  # marginals about the newest keyframe; None: ask the smoother
    noise_index: int = 0  # which noise setting of robot and sensor it assumes
    start: int = 0  # which start pose it assumes (global localisation)
    elsewhere: frozenset[int] = frozenset()  # map objects while the robot is not localised on the map: never detected
    left_behind: frozenset[int] = frozenset()  # likewise, of a robot carried to new ground; these occlude nothing
    noise_settings: NoiseSettings | None = None  # of ``noise_index``; None: all as configured
    slip: Array | None = None  # (r, r) covariance that slip adds to the next motion; None: it does not slip
    slipped: bool = False  # whether the newest motion did so
    movers: Movers | None = None  # objects that move or may move; None: nothing moves
    metre: Metre | None = None  # uncertainty of the global scale; None: the scale is known
    outliers: OutlierCounts = field(default_factory=OutlierCounts)  # detections with outlying positions, so far
    past: tuple[Array, ...] = ()  # (n, s) marginalised robot poses, frozen at their last estimate
    _moved: list[Motion] = field(default_factory=list, init=False, compare=False, repr=False)  # cache of ``moved_by``

    @classmethod
    def root(
        cls,
        spaces: Spaces,
        model: ObservationModel,
        robot: GaussianPrior,
        objects: dict[int, GaussianPrior],
        latent: LatentObservation | None = None,
        existence: dict[int, float] | None = None,
        joint: JointPrior | None = None,
    ) -> "Component":
        """The prior of Eq. 4.3, ``joint`` over some objects; descriptor variables enter with an object's first view."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        together = joint.every_id if joint is not None else frozenset[int]()
        for key, prior in [(robot_key(-1), robot), *((object_key(n), prior) for n, prior in objects.items())]:
            if key == robot_key(-1) or number_of(key) not in together:
                for factor in prior.factors(spaces.of(key), key):
                    graph.add(factor)
            spaces.of(key).insert(values, key, prior.mean)
        if joint is not None:
            keys = [object_key(n) for n in joint.object_ids]
            for factor in (*joint_prior_factors(keys, joint.covariance, values), *twin_factors(joint.twins, values)):
                graph.add(factor)
        smoother = Smoother.of(spaces, SemanticFactorMaker(spaces, model, latent), graph, values)
        ids, stated = sorted(objects), existence or {}
        known = HypothesisObjects(
            ids=np.array(ids, dtype=int), existence_given=np.array([stated.get(n, 1.0) for n in ids]).reshape(-1, 1)
        )
        return cls(spaces=spaces, model=model, smoother=smoother, objects=known)

    @property
    def object_ids(self) -> frozenset[int]:
        """Ids of its objects, without those that it has decided are moving."""
        return self.objects.id_set

    @property
    def every_id(self) -> frozenset[int]:
        """Ids of all its objects, moving ones included."""
        moving = frozenset[int]() if self.movers is None else self.movers.decided_ids
        return self.object_ids | moving if moving else self.object_ids

    def newest_robot(self) -> Array:
        """(s,) estimate of the robot's pose at the newest keyframe."""
        return np.asarray(self.states([robot_key(self.keyframe)])[0, : self.spaces.storage.robot])

    def observer(self, robot_covariance: Array) -> Observers:
        """The newest pose of a robot in the plane, of this covariance (3, 3), with its sensor's constant errors."""
        mean, spread = (np.zeros(0), np.zeros((0, 3))) if self.tracked is None else self.tracked.constant_errors
        return Observers.of(self.newest_robot()[None], robot_covariance[None], mean[None], spread[None])

    @property
    def oldest(self) -> int:
        """Keyframe of the oldest robot pose that is still a variable; -1 where none has been marginalised."""
        return sum(len(part) for part in self.past) - 1

    def path(self) -> Array:
        """(1 + k, s) robot pose at every keyframe from the first; marginalised poses as they were when marginalised."""
        keys = [robot_key(keyframe) for keyframe in range(self.oldest, self.keyframe + 1)]
        parts = [*self.past, self.states(keys)[:, : self.spaces.storage.robot]]
        return np.concatenate(parts)[1:]

    def without_past(self, oldest: int) -> "Component":
        """The component with the poses before keyframe ``oldest`` marginalised (fixed lag). Raises LostComponentError.

        No window may reach back before ``oldest``.
        """
        keys = [robot_key(keyframe) for keyframe in range(self.oldest, oldest)]
        frozen = self.states(keys)[:, : self.spaces.storage.robot]
        smoother, tracked = without_past(self.smoother, oldest, self.every_id), self.tracked
        if tracked is not None:
            tracked = tracked_again(smoother, self.keyframe, tracked, self.objects.ids)
            tracked = tracked.with_thinned_trail(self.keyframe + 1 - oldest)
        return replace(self, smoother=smoother, past=(*self.past, frozen), tracked=tracked)

    def states(self, keys: Sequence[int]) -> Array:
        """(n, s) estimates, padded to the wider of robot and object states."""
        return self.smoother.states(keys)

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """(m, m) marginal covariance, in the tangent spaces at the estimate. Raises LostComponentError."""
        return self.smoother.joint_covariance(keys)

    def joint_of_objects(self, object_ids: Sequence[int]) -> tuple[Array, Array]:
        """(n, s) states and (n l, n l) joint covariance of some of its objects, in the tangent spaces there.

        Includes the moment corrections that their Gaussians and factors lack (correlations are kept), and the
        uncertainty of the global scale. Raises LostComponentError.
        """
        keys, space = [object_key(n) for n in object_ids], self.spaces.landmark
        size = space.tangent_size
        states = self.states(keys)[:, : space.storage_size].copy()
        covariance = self.joint_covariance(keys) if keys else np.zeros((0, 0))
        for key, correction in self._corrections():
            if key in keys:
                row = keys.index(key)
                own = slice(row * size, (row + 1) * size)
                before = covariance[own, own].copy()
                states[row], after = correction.applied(space, states[row], before)
                change = transport(before, after)
                covariance[own] = change @ covariance[own]
                covariance[:, own] = covariance[:, own] @ change.T
        return states, covariance if self.metre is None else self.metre.jointly_widened(states, covariance)

    def robot_and_objects(self, object_ids: Sequence[int]) -> tuple[Array, Array]:
        """(1 + n, s) states, the robot's first, and (1 + n, w, w) covariances of some of its objects.

        Includes the moment corrections and yaws that their Gaussians and factors lack, and the uncertainty of the
        global scale. Raises LostComponentError.
        """
        keys = [robot_key(self.keyframe), *(object_key(n) for n in object_ids)]
        states, covariances = self._uncorrected(keys, object_ids)
        for key, correction in self._corrections():
            if key in keys:
                row = keys.index(key)
                space = self.spaces.of(key)
                at, block = (
                    (row, slice(space.storage_size)),
                    (row, slice(space.tangent_size), slice(space.tangent_size)),
                )
                states[at], covariances[block] = correction.applied(space, states[at], covariances[block])
        for row, number in enumerate(object_ids, start=1):
            if number in self.views and (yaw := self.views[number].yaw) is not None:
                states[row], covariances[row] = yaw.applied(states[row], covariances[row])
        return states, covariances if self.metre is None else self.metre.widened(states, covariances)

    def _uncorrected(self, keys: Sequence[int], object_ids: Sequence[int]) -> tuple[Array, Array]:
        """States and covariances of robot and objects: the tracked ones, or else read from the smoother."""
        if self.tracked is None:
            return self.states(keys), self.smoother.joint_blocks(keys)
        rows = self.objects.rows(np.array(object_ids, dtype=int))
        tracked, spaces = self.tracked, self.spaces
        states = spaces.storage.stacked(tracked.robot[None], tracked.states[rows])
        return states, spaces.layout.stacked_squares(tracked.robot_covariance, tracked.covariances[rows])

    def _corrections(self) -> list[tuple[int, Correction]]:
        """Moment corrections of the Gaussians, with their GTSAM keys, in the order in which they apply."""
        semantic = [(object_key(number), views.correction) for number, views in self.views.items()]
        every = [*self.corrections.items(), *semantic, (robot_key(self.keyframe), self.robot_correction)]
        return [(key, correction) for key, correction in every if correction is not None]

    def tracked_heading(self, object_id: int) -> tuple[float, float] | None:
        """Mean [rad] and variance of an object's tracked heading; None for a new object, or if nothing is tracked.

        In space the heading is the yaw, and objects are upright.
        """
        space = self.spaces.landmark
        if self.tracked is None or object_id not in self.object_ids or space.own_turn is None:
            return None
        row = int(self.objects.rows(np.array(object_id)))
        state, variance = self.tracked.states[row], float(self.tracked.covariances[row, space.own_turn, space.own_turn])
        if space.heading is not None:
            return float(state[space.heading]), variance
        return float(planar_from_pose_vector(space.poses(state))[2]), variance

    def sensed(self, detections: Sequence[Any]) -> Sequence[Any]:
        """The detections with the noise that this hypothesis assumes."""
        if self.noise_settings is None or self.noise_settings.as_told:
            return detections
        return [detection.taken_as(self.noise_settings) for detection in detections]

    def log_change(self, detections: Sequence[Any]) -> float:
        """Log density of the detections as measured, relative to that of :meth:`sensed` (ranges from depths)."""
        if self.noise_settings is None or not self.noise_settings.ranges_are_depth:
            return 0.0
        return float(sum(detection.log_change(self.noise_settings) for detection in detections))

    def moved_by(self, motion: Motion) -> Motion:
        """Odometry with the noise and clock offset that this hypothesis assumes; cached for the newest motion."""
        if not self._moved or self._moved[0] is not motion:
            self._moved[:] = motion, self._moved_by(motion)
        return self._moved[1]

    def _moved_by(self, motion: Motion) -> Motion:
        if self.noise_settings is not None and self.noise_settings.odometry_factor != 1.0:
            motion = replace(motion, covariance=self.noise_settings.odometry_factor * motion.covariance)
        if self.slip is not None:
            motion = replace(motion, covariance=motion.covariance + self.slip)
        if motion.shifts is None or motion.by_bias is None or self.tracked is None:
            return motion
        mean, sigma = self.tracked.clock
        line = line_at(motion.control, motion.shifts, mean, sigma)
        change = np.column_stack([motion.by_bias[:, :CLOCK], line.slope])
        return Motion(line.control, motion.covariance + line.covariance, change)

    def on_new_ground(self) -> "Component":
        """The component of a robot carried (kidnapped) to new ground, where it meets no object known before."""
        moving = None if self.movers is None else self.movers.take(np.zeros(0, dtype=int))
        tracked = tracked_states(self).with_trail_left_behind()
        return replace(self, left_behind=self.object_ids, tracked=tracked, movers=moving)

    def fork(self) -> "Component":
        """A copy with a fork of the smoother, independent of this one."""
        return replace(self, smoother=self.smoother.fork())

    def child(self, update: ComponentUpdate, smoother: Smoother, max_fresh: int, *, far: bool = False) -> "Component":
        """The component of one continuation, with a ``smoother`` that has its factors. Raises LostComponentError.

        Where states are tracked, marginal covariances of all objects are recomputed if there are at most ``max_fresh``,
        else those of the objects observed. ``far``: the robot's mode is far from the prediction, so that the local map
        does not hold.
        """
        objects, keyframe = self.objects.updated(update.existence), self.keyframe + 1
        classes, views = self.classes | update.assigned_classes, self.views | update.views
        if not update.existence.kept.all():
            alive = objects.id_set if update.movers is None else objects.id_set | update.movers.decided_ids
            classes = {n: cls for n, cls in classes.items() if n in alive}
            views = {n: record for n, record in views.items() if n in alive}
        tracked, local = self.tracked, None
        if tracked is not None:
            tracked, local = tracked_after(smoother, keyframe, tracked, objects.ids, update, max_fresh)
        return replace(
            self,
            smoother=smoother,
            objects=objects,
            keyframe=keyframe,
            classes=classes,
            views=views,
            robot_correction=update.robot_correction,
            window=update.window,
            corrections=update.corrections,
            tracked=tracked,
            local=None if far else local,
            slip=None,
            slipped=self.slip is not None,
            movers=update.movers,
            outliers=self.outliers if update.outliers is None else update.outliers,
        )


def tracked_states(component: Component) -> TrackedStates:
    """The tracked states of a component of an open world."""
    assert component.tracked is not None
    return component.tracked


@dataclass(frozen=True)
class WeightedComponent:
    """A hypothesis as a backend holds it: its component and log weight."""

    component: Component
    log_weight: float
