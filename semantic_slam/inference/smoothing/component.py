"""One hypothesis's smoothed belief b[X_k] (Eq. 4.9): an iSAM2 that is forked when the hypothesis branches."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.latent_observation import LatentObservation
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import AssociatedDetection, Motion
from semantic_slam.inference.smoothing.batch_update import Extension
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.semantic_factors import SemanticFactor, SemanticFactorMaker
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import descriptor_key, object_key, robot_key
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.inference.states.spaces import Spaces

if TYPE_CHECKING:
    from semantic_slam.inference.evidence.window import Window
    from semantic_slam.inference.smoothing.keyframe_factors import KeyframeFactors

__all__ = ["AssociatedDetection", "Component", "ComponentUpdate", "LostComponentError", "Motion", "WeightedComponent"]
__all__ += ["descriptor_key", "object_key", "robot_key"]


JUMP = 0.5
"""Change of the robot's predicted state, metres or radians, from which on the whole graph is optimised at once."""
TURN_RAD = 0.3
"""Change of an object's heading from which on it is, too."""


@dataclass(frozen=True)
class ComponentUpdate:
    """What a continuation is, besides its motion and detections."""

    robot: Array  # (s,) mode of the robot, where the new factors are created
    objects: Sequence[Array]  # one (s,) for each observed object, too
    new_objects: dict[int, GaussianPrior]
    views: dict[int, ObjectViews]  # new records of those objects
    robot_correction: Correction | None
    history: "Window | None"  # since the component was last Gaussian
    smoothed: dict[int, Array]  # GTSAM key -> (s,) mode, where the whole history was looked at
    corrections: dict[int, Correction]  # GTSAM key -> of the Gaussian at that mode


@dataclass(frozen=True)
class Component:
    """The smoother, the newest robot key and the classes enumerated so far; an only child may use its smoother up."""

    spaces: Spaces
    model: ObservationModel
    smoother: Smoother
    keyframe: int  # newest, -1 before the first
    classes: dict[int, int] = field(default_factory=dict)  # object id -> enumerated class
    object_ids: frozenset[int] = frozenset()
    views: dict[int, ObjectViews] = field(default_factory=dict)  # object id -> record of its semantic views
    robot_correction: Correction | None = None  # of the newest robot pose, by semantics that have no factor
    history: "Window | None" = None  # None: the component is Gaussian
    corrections: dict[int, Correction] = field(default_factory=dict)  # GTSAM key -> of a Gaussian that does not suffice

    @classmethod
    def root(
        cls,
        spaces: Spaces,
        model: ObservationModel,
        robot: GaussianPrior,
        objects: dict[int, GaussianPrior],
        latent: LatentObservation | None = None,
    ) -> "Component":
        """The prior of Eq. 4.3; descriptors enter with the first view of their object."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for key, prior in [(robot_key(-1), robot), *((object_key(n), prior) for n, prior in objects.items())]:
            graph.add(spaces.of(key).prior_factor(key, prior.mean, prior.covariance))
            spaces.of(key).insert(values, key, prior.mean)
        smoother = Smoother.of(spaces, SemanticFactorMaker(spaces, model, latent), graph, values)
        return cls(spaces, model, smoother, -1, object_ids=frozenset(objects))

    def newest_robot(self) -> Array:
        """(s,) estimate of the robot at the newest keyframe."""
        return np.asarray(self.states([robot_key(self.keyframe)])[0, : self.spaces.storage.robot])

    def states(self, keys: Sequence[int]) -> Array:
        """(n, s) estimates, as wide as the wider of robots and objects."""
        return self.smoother.states(keys)

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """(m, m) marginal covariance, in the tangent spaces at the estimate. Raises LostComponentError."""
        return self.smoother.joint_covariance(keys)

    def corrected(self, keys: Sequence[int]) -> tuple[Array, Array]:
        """(n, s) estimates and (n, w, w) covariances with what their Gaussians and their factors do not say."""
        states, covariances = self.states(keys), self.smoother.joint_blocks(keys)
        for key, correction in self._corrections():
            if key in keys:
                row = keys.index(key)
                own = self.spaces.of(key)
                at, block = (row, slice(own.storage_size)), (row, slice(own.tangent_size), slice(own.tangent_size))
                states[at], covariances[block] = correction.applied(own, states[at], covariances[block])
        return states, covariances

    def _corrections(self) -> list[tuple[int, Correction]]:
        """By GTSAM keys, in the order in which they apply."""
        semantic = [(object_key(number), views.correction) for number, views in self.views.items()]
        every = [*self.corrections.items(), *semantic, (robot_key(self.keyframe), self.robot_correction)]
        return [(key, correction) for key, correction in every if correction is not None]

    def extension(
        self,
        shared: "KeyframeFactors",
        observed: Sequence[AssociatedDetection],
        continued: ComponentUpdate,
        predicted: Array,
        moved: float,
    ) -> Extension:
        """What one continuation adds to the smoother (Eqs. 4.9-4.11).

        Its robot's mode is ``moved`` metres or radians from the state ``predicted`` by the motion alone.
        """
        key = robot_key(self.keyframe + 1)
        graph, values = self._new(shared, observed, continued.robot, continued.new_objects)
        named = self._classed(observed)
        start = {key: continued.robot} | continued.smoothed
        start |= {object_key(item.object_id): o for item, o in zip(observed, continued.objects, strict=True)}
        jumped = self._jumped(moved, continued)
        if self.smoother.semantics.latent is None:
            return Extension(graph, values, named, start, jumped)
        entering = descriptor_views(continued.views)
        start |= self.with_descriptors(graph, values, continued.views, entering, start)
        calm = {key: predicted} | self.calm(continued.views)
        return Extension(graph, values, [*named, *entering], start, jumped or self.turned(continued.views), calm)

    def child(
        self, observed: Sequence[AssociatedDetection], continued: ComponentUpdate, smoother: Smoother
    ) -> "Component":
        """The component of one continuation, whose ``smoother`` has its extension."""
        assigned = {item.object_id: item.assigned_class for item in observed if item.assigned_class >= 0}
        return Component(
            self.spaces,
            self.model,
            smoother,
            self.keyframe + 1,
            self.classes | assigned,
            self.object_ids | continued.new_objects.keys(),
            self.views | continued.views,
            continued.robot_correction,
            continued.history,
            continued.corrections,
        )

    def with_descriptors(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        views: Mapping[int, ObjectViews],
        entering: Sequence[SemanticFactor],
        start: Mapping[int, Array],
    ) -> dict[int, Array]:
        """Add the variables E(n) that ``entering`` views need; states of all their variables that ``start`` lacks."""
        states: dict[int, Array] = {}
        for number, record in views.items():
            key, guess = descriptor_key(number), record.descriptor
            if guess is None or not guess.entering:
                continue
            states[key] = guess.mean
            if guess.heading_rad is not None:
                own = object_key(number)
                states[own] = np.append(start[own][:-1], guess.heading_rad)
            if not self.smoother.has(key):
                prior = self.smoother.semantics.descriptor_prior(number)
                graph.add(gtsam.PriorFactorVector(key, prior.mean[0], gtsam.noiseModel.Diagonal.Sigmas(prior.sigma[0])))
                values.insert(key, guess.mean)
        lacking = sorted({key for item in entering for key in item.keys} - start.keys() - states.keys())
        known = zip(lacking, self.states(lacking), strict=True)
        return states | {key: self.spaces.own(key, state) for key, state in known}

    def calm(self, views: Mapping[int, ObjectViews]) -> dict[int, Array]:
        """Where descriptors and the objects that their views turn begin, if all else stays as it was."""
        states: dict[int, Array] = {}
        for number, record in views.items():
            guess, own = record.descriptor, object_key(number)
            if guess is None or not guess.entering:
                continue
            states[descriptor_key(number)] = guess.mean
            if guess.heading_rad is not None and self.smoother.has(own):
                states[own] = np.append(self.states([own])[0, :-1], guess.heading_rad)
        return states

    def turned(self, views: Mapping[int, ObjectViews]) -> bool:
        """Whether views that enter now turn an object: linear factors do not tell true from so far away."""
        return any(
            record.descriptor is not None
            and record.descriptor.heading_rad is not None
            and len(record.descriptor.entering) > 0
            and self._turn(number, record.descriptor.heading_rad) > TURN_RAD
            for number, record in views.items()
        )

    def _turn(self, object_id: int, heading_rad: float) -> float:
        """Between an object's estimated heading and another; infinite for a new object."""
        key = object_key(object_id)
        if not self.smoother.has(key):
            return np.inf
        return float(np.abs(wrap_angle(self.states([key])[0, -1] - heading_rad)))

    def _new(
        self,
        shared: "KeyframeFactors",
        observed: Sequence[AssociatedDetection],
        robot: Array,
        new_objects: Mapping[int, GaussianPrior],
    ) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """Odometry, priors of new objects and geometry; and values of the new keys, the robot's (s,) where it is."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        graph.add(shared.odometry)
        self.spaces.robot.insert(values, robot_key(self.keyframe + 1), robot)
        for number, prior in new_objects.items():
            graph.add(self.spaces.landmark.prior_factor(object_key(number), prior.mean, prior.covariance))
            self.spaces.landmark.insert(values, object_key(number), prior.mean)
        for item in observed:
            graph.add(shared.geometry(item))
        return graph, values

    def _classed(self, observed: Sequence[AssociatedDetection]) -> list[SemanticFactor]:
        """The semantic measurements of the next keyframe under a class."""
        key = robot_key(self.keyframe + 1)
        classed = [item for item in observed if item.assigned_class >= 0]
        return [
            SemanticFactor(key, object_key(item.object_id), item.detection, item.assigned_class) for item in classed
        ]

    def _jumped(self, moved: float, continued: ComponentUpdate) -> bool:
        """Whether the continuation's mode is elsewhere than the estimate, or should be met exactly."""
        if continued.history is not None or moved > JUMP:
            return True
        past = [key for key in continued.smoothed if self.smoother.has(key)]
        if not past:
            return False
        modes = [continued.smoothed[key] for key in past]
        return self.spaces.largest_change(past, self.states(past), modes) > JUMP


def descriptor_views(views: Mapping[int, ObjectViews]) -> list[SemanticFactor]:
    """The semantic measurements that enter the graph with new records of objects."""
    return [
        SemanticFactor(
            robot_key(keyframe), object_key(number), detection, -1, descriptor_key(number), record.descriptor.is_bent
        )
        for number, record in views.items()
        if record.descriptor is not None
        for keyframe, detection in record.descriptor.entering
    ]


@dataclass(frozen=True)
class WeightedComponent:
    """A hypothesis as a backend holds it."""

    component: Component
    log_weight: float
