"""A hypothesis's smoothed belief in an open world: an iSAM2 and the population of its objects."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.moments import position_sigmas
from semantic_slam.inference.models.odometry_bias import bias_change
from semantic_slam.inference.models.step import AssociatedDetection, Motion
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.smoothing.batch_update import Extension
from semantic_slam.inference.smoothing.component import JUMP, Component, descriptor_views
from semantic_slam.inference.smoothing.keyframe_factors import KeyframeFactors
from semantic_slam.inference.smoothing.local_map import LocalMap
from semantic_slam.inference.smoothing.semantic_factors import SemanticFactor
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import begins_stretch, bias_key, object_key, robot_key
from semantic_slam.inference.states.object_table import ExistenceUpdate, ObjectTable
from semantic_slam.inference.states.object_views import ObjectViews


@dataclass(frozen=True)
class OpenUpdate:
    """What one continuation adds to its parent."""

    observed: Sequence[AssociatedDetection]
    objects: Sequence[Array]  # (s,) mode of the object of each entry of ``observed``
    robot: Array  # (s,) mode
    predicted: Array  # (s,) of the robot, by odometry alone
    new_objects: dict[int, GaussianPrior]
    views: dict[int, ObjectViews]
    robot_correction: Correction | None
    account: ExistenceUpdate
    local: LocalMap | None  # after the detections, where updates are not iterated


@dataclass(frozen=True)
class OpenComponent(Component):
    """``population`` mirrors what iSAM2 holds; ``settle`` False: one update per keyframe, and a ``local`` map."""

    population: ObjectTable | None = None
    settle: bool = True
    local: LocalMap | None = None  # after the newest keyframe; None: ask the smoother
    noise: int = 0  # which of the noises that odometry may have
    noise_factor: float = 1.0  # of that one, on the covariance

    @property
    def objects(self) -> ObjectTable:
        """The population, which is there from the start."""
        assert self.population is not None
        return self.population

    @classmethod
    def before_any_keyframe(cls, problem: Problem, noise: int = 0) -> "OpenComponent":
        """The prior of Eq. 4.3 with what existence the map states, under one of the noises of odometry."""
        plain, settle = problem.root(), problem.open_world.settle
        smoother = plain.smoother
        if not settle:
            smoother = smoother.with_single_steps(problem.num_biases)
        entries = sorted(problem.objects, key=lambda entry: entry.object_id)
        storage, size = problem.spaces.storage, problem.spaces.layout.landmark
        states = np.array([entry.prior.mean for entry in entries]).reshape(-1, storage.landmark)
        covariances = np.array([entry.prior.covariance for entry in entries]).reshape(-1, size, size)
        population = ObjectTable(
            ids=np.array([entry.object_id for entry in entries], dtype=int),
            existence=np.array([entry.existence for entry in entries], dtype=np.float64),
            states=states,
            covariances=covariances,
            sigmas=position_sigmas(covariances),
            robot=problem.robot.mean,
            robot_covariance=problem.robot.covariance,
            trail=np.zeros((0, storage.robot)),
            bias=np.zeros(problem.num_biases),
            bias_covariance=_with_unit_bias(problem.robot.covariance, problem.num_biases),
        )
        return cls(
            problem.spaces,
            problem.model,
            smoother,
            -1,
            object_ids=plain.object_ids,
            population=population,
            settle=settle,
            noise=noise,
            noise_factor=problem.noise_factors[noise],
        )

    def extension_by(self, shared: KeyframeFactors, added: OpenUpdate) -> Extension:
        """What one continuation adds to the smoother, to settle there."""
        graph, values, named, start = self._extended(shared, added)
        entering = descriptor_views(added.views)
        start |= self.with_descriptors(graph, values, added.views, entering, start)
        calm = {robot_key(self.keyframe + 1): added.predicted} | self.calm(added.views)
        jumped = self._jumped_to(added) or self.turned(added.views)
        return Extension(graph, values, [*named, *entering], start, jumped, calm)

    def stepped_by(self, shared: KeyframeFactors, added: OpenUpdate, *, in_place: bool) -> Smoother:
        """After one update, the next keyframe going on; ``in_place`` uses up this component. Raises LostComponentError.

        Descriptors then stay with their records: they enter with a turn of their object, which one update cannot make.
        """
        again = self._jumped_to(added)
        return self.smoother.stepped(*self._extended(shared, added), in_place=in_place, again=again)

    def grown(self, added: OpenUpdate, smoother: Smoother, max_fresh: int) -> "OpenComponent":
        """The child of one continuation, whose ``smoother`` has its factors. Raises LostComponentError.

        ``max_fresh`` objects at most get fresh marginal covariances besides those observed.
        """
        keyframe, account = self.keyframe + 1, added.account
        alive = frozenset((*self.objects.ids[account.kept].tolist(), *account.new_ids.tolist()))
        classes = self.classes | {o.object_id: o.assigned_class for o in added.observed if o.assigned_class >= 0}
        return replace(
            self,
            smoother=smoother,
            keyframe=keyframe,
            classes={number: cls for number, cls in classes.items() if number in alive},
            object_ids=alive,
            views={number: views for number, views in (self.views | added.views).items() if number in alive},
            robot_correction=added.robot_correction,
            local=None if self._jumped_to(added) else added.local,
            population=_population(smoother, keyframe, self.objects, added, max_fresh),
        )

    def _jumped_to(self, added: OpenUpdate) -> bool:
        """Whether the robot's mode is elsewhere than odometry has it."""
        change = np.abs(self.spaces.robot.local(added.predicted, added.robot))
        limit = JUMP if self.settle else np.maximum(JUMP, self.spaces.robot.far)
        return bool((change > limit).any())

    def _extended(
        self, shared: KeyframeFactors, added: OpenUpdate
    ) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, list[SemanticFactor], dict[int, Array]]:
        """The keyframe's factors and new variables, semantic measurements, and where the continuation has them."""
        key = robot_key(self.keyframe + 1)
        graph, values = self._new(shared, added.observed, added.robot, added.new_objects)
        if shared.motion.by_bias is not None and begins_stretch(self.keyframe + 1):
            bias_change(self.keyframe + 1, self.objects.bias, graph, values)
        start = {key: added.robot}
        start |= {object_key(item.object_id): o for item, o in zip(added.observed, added.objects, strict=True)}
        return graph, values, self._classed(added.observed), start

    def scaled(self, motion: Motion) -> Motion:
        """Odometry with the noise that this hypothesis takes it to have."""
        if self.noise_factor == 1.0:
            return motion
        return Motion(motion.control, self.noise_factor * motion.covariance, motion.by_bias)

    def control(self, motion: Motion) -> Array:
        """(s,) odometry without what it always gets wrong, as far as that is known."""
        if motion.by_bias is None:
            return motion.control
        return self.spaces.robot.retract(motion.control, motion.by_bias @ self.objects.bias)

    def robot_and_objects(self) -> tuple[Array, Array]:
        """(1 + O, s) states as the population has them, the robot first, and their covariances, corrected."""
        population = self.objects
        states = self.spaces.storage.stacked(population.robot[None], population.states)
        covariances = self.spaces.layout.stacked_squares(population.robot_covariance, population.covariances)
        corrections = [self.robot_correction]
        if self.views:
            corrections += [self._correction(int(n)) for n in population.ids]
        for row, correction in enumerate(corrections):
            if correction is not None:
                own = self.spaces.landmark if row else self.spaces.robot
                at, block = (row, slice(own.storage_size)), (row, slice(own.tangent_size), slice(own.tangent_size))
                states[at], covariances[block] = correction.applied(own, states[at], covariances[block])
        return states, covariances

    def _correction(self, object_id: int) -> Correction | None:
        views = self.views.get(object_id)
        return views.correction if views is not None else None


def _population(
    smoother: Smoother, keyframe: int, parent: ObjectTable, added: OpenUpdate, max_fresh: int
) -> ObjectTable:
    account, layout, storage = added.account, smoother.spaces.layout, smoother.spaces.storage
    kept, new = account.kept, len(account.new_ids)
    ids = np.concatenate([parent.ids[kept], account.new_ids])
    keys = [object_key(int(n)) for n in ids]
    states = smoother.states([*keys, robot_key(keyframe)])
    unknown = np.zeros((new, layout.landmark, layout.landmark))
    covariances = np.concatenate([parent.covariances[kept], unknown])
    sigmas = np.concatenate([parent.sigmas[kept], np.zeros(new)])
    fresh = np.arange(len(ids))
    if len(ids) > max_fresh:
        fresh = np.unique(np.searchsorted(ids, [item.object_id for item in added.observed])).astype(int)
    together, covariances[fresh] = _joint(smoother, keyframe, parent, added.local, ids[fresh])
    sigmas[fresh] = position_sigmas(covariances[fresh])
    return ObjectTable(
        ids=ids,
        existence=np.concatenate([account.existence[kept], account.new_existence]),
        states=states[:-1, : storage.landmark],
        covariances=covariances,
        sigmas=sigmas,
        robot=states[-1, : storage.robot],
        robot_covariance=together[: layout.robot, : layout.robot],
        trail=np.concatenate([parent.trail, states[-1:, : storage.robot]]),
        bias=smoother.vector(bias_key(keyframe)) if len(parent.bias) else parent.bias,
        bias_covariance=together if len(parent.bias) else None,
    )


def _joint(
    smoother: Smoother, keyframe: int, parent: ObjectTable, local: LocalMap | None, object_ids: Index
) -> tuple[Array, Array]:
    """(r + p, r + p) of robot and biases, and (n, l, l) of objects: from the local map where that holds them."""
    size, biases = smoother.spaces.layout.robot, len(parent.bias)
    if local is not None and local.holds(object_ids):
        return local.covariance[: size + biases, : size + biases], local.single(object_ids)
    robot = [robot_key(keyframe), *[bias_key(keyframe)][:biases]]
    return smoother.joint_covariance(robot), smoother.covariances([object_key(n) for n in object_ids.tolist()])


def _with_unit_bias(robot: Array, num_biases: int) -> Array | None:
    """Covariance of the robot and biases that nothing is known of yet."""
    if not num_biases:
        return None
    size = len(robot)
    together = np.eye(size + num_biases)
    together[:size, :size] = robot
    return together
