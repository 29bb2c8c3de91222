"""One hypothesis's smoothed belief b[X_k] (Eq. 4.9): an iSAM2 that is forked when the hypothesis branches."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.gaussian import GaussianPrior
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.object_views import Correction, ObjectViews
from semantic_slam.inference.observation import ObservationModel
from semantic_slam.inference.stack import Predicted

Array = NDArray[np.float64]

MAX_UPDATES = 8
CONVERGED = 1e-4
"""Largest change of a state of this keyframe, metres or radians, after which an update counts as converged."""
RELINEARIZE_THRESHOLD = 0.02
WILDFIRE_THRESHOLD = 1e-9
"""Back-substitution goes on until changes are below this, so that estimates are those of the whole system."""
JUMP = 0.5
"""Change of the robot's predicted state, metres or radians, from which on the whole graph is optimised at once."""


class LostComponentError(SemanticSlamError):
    """A component's linear system is indeterminate; its hypothesis has to be given up."""


def robot_key(keyframe: int) -> int:
    """X(k + 1) for keyframe k; X(0) is the prior pose."""
    return int(gtsam.symbol("x", keyframe + 1))


def object_key(object_id: int) -> int:
    """O(n)."""
    return int(gtsam.symbol("o", object_id))


@dataclass(frozen=True)
class Motion:
    """Odometry from one keyframe to the next."""

    control: Array  # (d,)
    covariance: Array  # (d, d)


@dataclass(frozen=True)
class Observed:
    """A detection with the object and class that a hypothesis gives it; class -1: no semantics."""

    detection: Any
    object_id: int
    assigned_class: int


@dataclass
class Component:
    """iSAM2, the newest robot key and the classes enumerated so far. :meth:`extended` leaves it as it was."""

    manifold: Manifold
    model: ObservationModel
    isam: gtsam.ISAM2
    keyframe: int  # newest, -1 before the first
    classes: dict[int, int] = field(default_factory=dict)  # object id -> enumerated class
    object_ids: frozenset[int] = frozenset()
    views: dict[int, ObjectViews] = field(default_factory=dict)  # object id -> record of its semantic views
    robot_correction: Correction | None = None  # of the newest robot pose, by semantics that have no factor

    @classmethod
    def root(
        cls, manifold: Manifold, model: ObservationModel, robot: GaussianPrior, objects: dict[int, GaussianPrior]
    ) -> "Component":
        """The prior of Eq. 4.3."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for key, prior in [(robot_key(-1), robot), *((object_key(n), prior) for n, prior in objects.items())]:
            graph.add(manifold.prior_factor(key, prior.mean, prior.covariance))
            manifold.insert(values, key, prior.mean)
        isam = _new_isam()
        isam.update(graph, values)
        return cls(manifold, model, isam, -1, object_ids=frozenset(objects))

    def newest_robot(self) -> Array:
        """(d,) estimate of the robot at the newest keyframe."""
        return np.asarray(self.states([robot_key(self.keyframe)])[0])

    def states(self, keys: Sequence[int]) -> Array:
        """(n, d) estimates."""
        return _states(self.manifold, self.isam, keys)

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """(n d, n d) marginal covariance in the order of ``keys``, in the tangent spaces at the estimate."""
        try:
            covariance = self.isam.jointMarginalCovariance(list(keys)).fullMatrix()
        except (RuntimeError, IndexError) as fault:
            raise LostComponentError(f"marginals are not to be had ({_first_line(fault)})") from None
        return np.asarray(0.5 * (covariance + covariance.T))

    def covariances(self, keys: Sequence[int]) -> Array:
        """(n, d, d) marginal covariances, in the tangent spaces at the estimate. Raises LostComponentError."""
        try:
            blocks = [self.isam.marginalCovariance(key) for key in keys]
        except (RuntimeError, IndexError) as fault:
            raise LostComponentError(f"marginals are not to be had ({_first_line(fault)})") from None
        return np.array(blocks).reshape(len(keys), self.manifold.dimension, self.manifold.dimension)

    def corrected(self, keys: Sequence[int]) -> tuple[Array, Array]:
        """(n, d) estimates and (n, d, d) covariances with what semantics without factors have to say of them."""
        states, covariances = self.states(keys), self.covariances(keys)
        corrections = {object_key(n): views.correction for n, views in self.views.items()}
        corrections[robot_key(self.keyframe)] = self.robot_correction
        for row, key in enumerate(keys):
            correction = corrections.get(key)
            if correction is not None:
                states[row], covariances[row] = correction.applied(self.manifold, states[row], covariances[row])
        return states, covariances

    def predict(self, motion: Motion, object_ids: Sequence[int]) -> Predicted:
        """b^-[x_k, O] (Eqs. 4.11, 4.21) for one parent, over the robot and the objects named."""
        keys = [robot_key(self.keyframe), *(object_key(n) for n in object_ids)]
        mean, covariance = self.states(keys), self.joint_covariance(keys)
        dimension = self.manifold.dimension
        transition = self.manifold.propagation(motion.control)
        mean[0] = self.manifold.compose(mean[0], motion.control)
        covariance[:dimension] = transition @ covariance[:dimension]
        covariance[:, :dimension] = covariance[:, :dimension] @ transition.T
        covariance[:dimension, :dimension] += motion.covariance
        return Predicted(mean[None], covariance[None])

    def extended(
        self,
        motion: Motion,
        observed: Sequence[Observed],
        new_objects: dict[int, GaussianPrior],
        robot: Array,
        objects: Sequence[Array],
        views: dict[int, ObjectViews],
        robot_correction: Correction | None,
    ) -> "Component":
        """The child of Eqs. 4.9-4.11 for one continuation.

        ``robot`` (d,) and ``objects`` (one (d,) per entry of ``observed``) are the continuation's mode, where the
        new factors are created; ``views`` are the new records of those objects. Raises LostComponentError when the
        system is indeterminate.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        keyframe = self.keyframe + 1
        key = robot_key(keyframe)
        predicted = self.manifold.compose(self.newest_robot(), motion.control)
        graph.add(self.manifold.between_factor(robot_key(self.keyframe), key, motion.control, motion.covariance))
        self.manifold.insert(values, key, robot)
        for number, prior in new_objects.items():
            graph.add(self.manifold.prior_factor(object_key(number), prior.mean, prior.covariance))
            self.manifold.insert(values, object_key(number), prior.mean)
        for item, state in zip(observed, objects, strict=True):
            keys = (key, object_key(item.object_id))
            for factor in self.model.factors(item.detection, keys, item.assigned_class, robot, state):
                graph.add(factor)
        isam = gtsam.ISAM2(self.isam)
        jumped = float(np.abs(self.manifold.local(predicted, robot)).max()) > JUMP
        touched = sorted({key, *(object_key(item.object_id) for item in observed)})
        isam = _updated(self.manifold, isam, graph, values, touched, jumped)
        classes = self.classes | {item.object_id: item.assigned_class for item in observed if item.assigned_class >= 0}
        object_ids = self.object_ids | new_objects.keys()
        known = self.views | views
        return Component(self.manifold, self.model, isam, keyframe, classes, object_ids, known, robot_correction)


def _updated(
    manifold: Manifold,
    isam: gtsam.ISAM2,
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    keys: list[int],
    jumped: bool,
) -> gtsam.ISAM2:
    """iSAM2 updates until they converge; Levenberg-Marquardt over the whole graph where they cannot."""
    try:
        isam.update(graph, values)
        if not jumped and _settled(manifold, isam, keys):
            return isam
        return _optimised(isam)
    except RuntimeError as fault:
        raise LostComponentError(f"an update failed ({_first_line(fault)})") from None


def _settled(manifold: Manifold, isam: gtsam.ISAM2, keys: list[int]) -> bool:
    before = _states(manifold, isam, keys)
    for _ in range(MAX_UPDATES):
        isam.update()
        after = _states(manifold, isam, keys)
        if np.abs(manifold.local(before, after)).max() < CONVERGED:
            return True
        before = after
    return False


def _states(manifold: Manifold, isam: gtsam.ISAM2, keys: Sequence[int]) -> Array:
    values = isam.calculateEstimate(list(keys))
    return np.array([manifold.state(values, key) for key in keys]).reshape(len(keys), manifold.dimension)


def _optimised(isam: gtsam.ISAM2) -> gtsam.ISAM2:
    """A new iSAM2 of the same factors, linearised at their Levenberg-Marquardt optimum."""
    factors = gtsam.NonlinearFactorGraph(isam.getFactorsUnsafe())
    optimum = gtsam.LevenbergMarquardtOptimizer(factors, isam.calculateEstimate()).optimize()
    renewed = _new_isam()
    renewed.update(factors, optimum)
    return renewed


def _new_isam() -> gtsam.ISAM2:
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    parameters.setRelinearizeThreshold(RELINEARIZE_THRESHOLD)
    solver = gtsam.ISAM2GaussNewtonParams()
    solver.setWildfireThreshold(WILDFIRE_THRESHOLD)
    parameters.setOptimizationParams(solver)
    return gtsam.ISAM2(parameters)


def _first_line(fault: BaseException) -> str:
    return next((line for line in str(fault).splitlines() if line.strip()), type(fault).__name__)
