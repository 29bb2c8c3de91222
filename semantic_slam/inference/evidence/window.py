"""The window of a non-Gaussian hypothesis: the keyframes since it was last Gaussian, kept until it is so again.

The anchor is the Gaussian component of that time. A hypothesis that is one of several modes of one association also
keeps its region, the soft share (responsibility) of the states that it stands for, so that the modes of an association
sum to its whole evidence.
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
    """A Gaussian belief over robot poses and objects, at which a window begins."""

    @property
    def spaces(self) -> Spaces:
        """State spaces of robot and objects."""

    @property
    def model(self) -> ObservationModel:
        """Observation model of the detections since the anchor."""

    @property
    def keyframe(self) -> int:
        """Index of the newest keyframe in the belief."""

    @property
    def window(self) -> "Window | None":
        """Window since the belief was last Gaussian; None if it is Gaussian."""

    def states(self, keys: Sequence[int]) -> Array:
        """(n, s) estimates by GTSAM keys, as wide as the wider of robots and objects."""

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """(n d, n d) marginal covariance. Raises LostComponentError."""


@dataclass(frozen=True)
class WindowStep:
    """One keyframe of a window: the motion, and the detections with their associations."""

    motion: Motion
    observed: tuple[AssociatedDetection, ...]


@dataclass(frozen=True, kw_only=True)
class ModeRegion:
    """Region of one of several modes: its responsibility, over the blocks of y that the window had when it split."""

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
    """A hypothesis's anchor, the keyframes since, and the log evidence of those keyframes."""

    anchor: Anchor
    taken: tuple[WindowStep, ...] = ()
    introduced: tuple[tuple[int, GaussianPrior], ...] = ()  # objects that the keyframes since have introduced
    regions: tuple[ModeRegion, ...] = ()
    log_evidence: float = 0.0

    @classmethod
    def of(cls, component: Anchor) -> "Window":
        """The window of a component; if that is Gaussian, an empty one with the component as its anchor."""
        return component.window if component.window is not None else cls(anchor=component)

    def with_keyframe(self, taken: WindowStep, new: dict[int, GaussianPrior], log_psi: float = 0.0) -> "Window":
        """The window with one keyframe more; ``log_psi`` estimates what it adds to the log evidence."""
        return replace(
            self,
            taken=(*self.taken, taken),
            introduced=(*self.introduced, *new.items()),
            log_evidence=self.log_evidence + log_psi,
        )

    def object_ids(self) -> list[int]:
        """Ids of the objects seen since the anchor, in the order of their first detections."""
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
        """The problem of all states since the anchor. Raises LostComponentError."""
        return window_problem_of([self])

    def log_share(self, problem: WindowProblem, y: Array) -> Array:
        """(B,) log responsibility of this mode, over all splits since the anchor."""
        return np.asarray(sum((region.log_share(problem, y) for region in self.regions), np.zeros(len(y))))


def window_problem_of(windows: Sequence[Window]) -> WindowProblem:
    """The batched problem of windows of the same shape. Raises LostComponentError."""
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
