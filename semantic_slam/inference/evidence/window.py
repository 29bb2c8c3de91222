"""What a hypothesis has seen since it was last Gaussian, kept until it is Gaussian again.

The anchor is the component of that time. A hypothesis that is one of several modes also keeps its region: the soft
share of the states that it answers for, so that the modes of one association sum to its whole evidence.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.linalg import block_diag

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.importance import Gaussians
from semantic_slam.inference.evidence.window_problem import AnchorPrior, WindowKeyframe, WindowProblem
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import AssociatedDetection, Motion
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces


class Anchor(Protocol):
    """A Gaussian belief over the robot's poses and the objects: a window begins at one."""

    @property
    def spaces(self) -> Spaces:
        """State spaces of robot and objects."""

    @property
    def model(self) -> ObservationModel:
        """Observation model of what is seen since the anchor."""

    @property
    def keyframe(self) -> int:
        """Index of the newest keyframe in the belief."""

    @property
    def window(self) -> "Window | None":
        """Window since the belief was last Gaussian; None where it is Gaussian."""

    def states(self, keys: Sequence[int]) -> Array:
        """(n, s) estimates by GTSAM keys, as wide as the wider of robots and objects."""

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """(n d, n d) marginal covariance. Raises LostComponentError."""


@dataclass(frozen=True)
class WindowStep:
    """One keyframe of a hypothesis."""

    motion: Motion
    observed: tuple[AssociatedDetection, ...]


@dataclass(frozen=True, kw_only=True)
class ModeRegion:
    """The share of one of several modes, over the blocks of y that a window had when it split."""

    modes: Gaussians
    number: int
    num_objects: int
    num_links: int

    def log_share(self, problem: WindowProblem, y: Array) -> Array:
        """(B,) log responsibility of the mode, a function of the window's earlier blocks."""
        anchor = problem.layout.size(self.num_objects)
        motions = y[:, problem.width : problem.motion_rows(self.num_links).start]
        earlier = np.concatenate([y[:, :anchor], motions], axis=1)
        return np.asarray(self.modes.log_responsibilities(earlier)[self.number])


@dataclass(frozen=True, kw_only=True)
class Window:
    """The anchor, the keyframes since, and the evidence of those keyframes."""

    anchor: Anchor
    taken: tuple[WindowStep, ...] = ()
    introduced: tuple[tuple[int, GaussianPrior], ...] = ()  # objects that the keyframes since have introduced
    regions: tuple[ModeRegion, ...] = ()
    log_evidence: float = 0.0

    @classmethod
    def of(cls, component: Anchor) -> "Window":
        """A component's, which is its own anchor where it is Gaussian."""
        return component.window if component.window is not None else cls(anchor=component)

    def with_keyframe(self, taken: WindowStep, new: dict[int, GaussianPrior], log_psi: float = 0.0) -> "Window":
        """One keyframe more, with an estimate of what it adds to the evidence."""
        return replace(
            self,
            taken=(*self.taken, taken),
            introduced=(*self.introduced, *new.items()),
            log_evidence=self.log_evidence + log_psi,
        )

    def object_ids(self) -> list[int]:
        """Objects seen since the anchor, in the order in which they were."""
        return list(dict.fromkeys(item.object_id for taken in self.taken for item in taken.observed))

    def shape(self) -> Hashable:
        """Key that is equal where one :class:`WindowProblem` serves several windows."""
        detections = tuple((id(o.detection), o.assigned_class >= 0) for t in self.taken for o in t.observed)
        return self.anchor.keyframe, len(self.taken), detections, len(self.object_ids())

    def anchored(self) -> tuple[Array, Array]:
        """Mean (1 + O, s) and covariance of the robot at the anchor and the objects. Raises LostComponentError."""
        anchor, objects = self.anchor, self.object_ids()
        introduced = dict(self.introduced)
        known = [n for n in objects if n not in introduced]
        keys = [robot_key(anchor.keyframe), *(object_key(n) for n in known)]
        mean, covariance = anchor.states(keys), anchor.joint_covariance(keys)
        if not introduced:
            return mean, covariance
        added, storage = [introduced[n] for n in objects if n in introduced], anchor.spaces.storage
        mean = storage.stacked(mean, np.array([prior.mean for prior in added]).reshape(-1, storage.landmark))
        covariance = block_diag(covariance, *(prior.covariance for prior in added))
        place = {n: i for i, n in enumerate([*known, *(n for n in objects if n in introduced)])}
        order = [0, *(1 + place[n] for n in objects)]
        rows = anchor.spaces.layout.rows(order)
        return mean[order], covariance[np.ix_(rows, rows)]

    def problem(self) -> WindowProblem:
        """The integral over everything since the anchor. Raises LostComponentError."""
        return window_problem_of([self])

    def log_share(self, problem: WindowProblem, y: Array) -> Array:
        """(B,) log of the share that this mode answers for."""
        return np.asarray(sum((region.log_share(problem, y) for region in self.regions), np.zeros(len(y))))


def window_problem_of(windows: Sequence[Window]) -> WindowProblem:
    """The problem of windows that have one shape. Raises LostComponentError."""
    first = windows[0]
    anchored = [window.anchored() for window in windows]
    places, classes = [], []
    for window in windows:
        place = {n: i for i, n in enumerate(window.object_ids())}
        observed = [item for taken in window.taken for item in taken.observed]
        places.append([place[item.object_id] for item in observed])
        classes.append([item.assigned_class for item in observed])
    links = [WindowKeyframe(taken.motion, tuple(item.detection for item in taken.observed)) for taken in first.taken]
    at_anchor = AnchorPrior(
        mean=np.array([mean for mean, _ in anchored]),
        covariance=np.array([covariance for _, covariance in anchored]),
        places=np.array(places, dtype=int),
        classes=np.array(classes, dtype=int),
    )
    return WindowProblem(first.anchor.spaces, first.anchor.model, at_anchor, links)
