"""One hypothesis's smoothed belief b[X_k] (Eq. 4.9): an iSAM2 that is forked when the hypothesis branches."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.gaussian import GaussianPrior
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.object_views import Correction, ObjectViews
from semantic_slam.inference.observation import ObservationModel
from semantic_slam.inference.stack import Predicted

if TYPE_CHECKING:
    from semantic_slam.inference.history import History

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


@dataclass(frozen=True)
class Continued:
    """What a continuation is, besides its motion and detections."""

    robot: Array  # (d,) mode of the robot, where the new factors are created
    objects: Sequence[Array]  # one (d,) for each observed object, too
    new_objects: dict[int, GaussianPrior]
    views: dict[int, ObjectViews]  # new records of those objects
    robot_correction: Correction | None
    history: "History | None"  # since the component was last Gaussian
    smoothed: dict[int, Array]  # GTSAM key -> (d,) mode, where the whole history was looked at
    corrections: dict[int, Correction]  # GTSAM key -> of the Gaussian at that mode


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
    history: "History | None" = None  # None: the component is Gaussian
    corrections: dict[int, Correction] = field(default_factory=dict)  # GTSAM key -> of a Gaussian that does not suffice

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
        """(n, d) estimates and (n, d, d) covariances with what their Gaussians and their factors do not say."""
        states, covariances = self.states(keys), self.covariances(keys)
        semantic = {object_key(n): views.correction for n, views in self.views.items()}
        semantic[robot_key(self.keyframe)] = self.robot_correction
        for row, key in enumerate(keys):
            for correction in (self.corrections.get(key), semantic.get(key)):
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

    def extended(self, motion: Motion, observed: Sequence[Observed], continued: Continued) -> "Component":
        """The child of Eqs. 4.9-4.11 for one continuation. Raises LostComponentError when it is indeterminate."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        keyframe = self.keyframe + 1
        key = robot_key(keyframe)
        graph.add(self.manifold.between_factor(robot_key(self.keyframe), key, motion.control, motion.covariance))
        self.manifold.insert(values, key, continued.robot)
        for number, prior in continued.new_objects.items():
            graph.add(self.manifold.prior_factor(object_key(number), prior.mean, prior.covariance))
            self.manifold.insert(values, object_key(number), prior.mean)
        for item, state in zip(observed, continued.objects, strict=True):
            keys = (key, object_key(item.object_id))
            for factor in self.model.factors(item.detection, keys, item.assigned_class, continued.robot, state):
                graph.add(factor)
        touched = sorted({key, *(object_key(item.object_id) for item in observed)})
        isam = self._updated(graph, values, touched, motion, continued)
        return Component(
            self.manifold,
            self.model,
            isam,
            keyframe,
            self.classes | {item.object_id: item.assigned_class for item in observed if item.assigned_class >= 0},
            self.object_ids | continued.new_objects.keys(),
            self.views | continued.views,
            continued.robot_correction,
            continued.history,
            continued.corrections,
        )

    def _updated(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        touched: list[int],
        motion: Motion,
        continued: Continued,
    ) -> gtsam.ISAM2:
        """A fork with updates until they converge; Levenberg-Marquardt over the whole graph where they cannot."""
        isam = gtsam.ISAM2(self.isam)
        predicted = self.manifold.compose(self.newest_robot(), motion.control)
        past = [key for key in continued.smoothed if self.isam.valueExists(key)]
        moved = [self.manifold.local(predicted, continued.robot)]
        moved += [
            self.manifold.local(state, continued.smoothed[key])
            for key, state in zip(past, self.states(past), strict=True)
        ]
        try:
            isam.update(graph, values)
            if np.abs(moved).max() <= JUMP and _settled(self.manifold, isam, touched):
                return isam
            return _optimised(self.manifold, isam, continued.smoothed)
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


def _optimised(manifold: Manifold, isam: gtsam.ISAM2, start: dict[int, Array]) -> gtsam.ISAM2:
    """A new iSAM2 of the same factors, linearised at their Levenberg-Marquardt optimum, sought from ``start``."""
    factors = gtsam.NonlinearFactorGraph(isam.getFactorsUnsafe())
    values = isam.calculateEstimate()
    for key, state in start.items():
        values.erase(key)
        manifold.insert(values, key, state)
    optimum = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
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


@dataclass(frozen=True)
class Held:
    """A hypothesis as a backend holds it."""

    component: Component
    log_weight: float
