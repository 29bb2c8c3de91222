"""One posterior mode of a hypothesis over its window: evidence, moments, and corrections of the Gaussian."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.window import Window
from semantic_slam.inference.evidence.window_problem import WindowProblem
from semantic_slam.inference.states.correction import Correction


@dataclass(frozen=True, kw_only=True)
class PosteriorMode:
    """One posterior mode of a candidate over its window."""

    log_evidence: float  # of everything since the anchor, in this mode's region
    effective_share: float  # effective sample size over the number of samples
    smoothed: dict[int, Array]  # GTSAM key -> (s,) mode: robot since the anchor, objects seen since
    window: Window | None  # None where the mode is Gaussian
    moments: "SampledMoments" = field(compare=False, repr=False)
    num_samples: int = 0

    @cached_property
    def corrections(self) -> dict[int, Correction]:
        """GTSAM key -> correction of the Gaussian at the mode by the samples; computed only for survivors."""
        return self.moments.corrections()


@dataclass(frozen=True)
class WindowSamples:
    """Samples of a window, which its modes share."""

    problem: WindowProblem  # of one window
    y: Array  # (N, size)

    @cached_property
    def states(self) -> Array:
        """(N, 1 + O, s) of the newest robot state and of the objects."""
        robots, objects = self.problem.states(self.y)
        return self.problem.spaces.storage.stacked(robots[:, -1:], objects)


@dataclass(frozen=True, kw_only=True)
class SampledMoments:
    """Samples of a mode's region, and the Gaussian that they correct."""

    drawn: WindowSamples
    y: Array  # (size,) mode
    hessian: Array  # (size, size)
    weights: Array  # (N,) normalised
    keys: Sequence[int]  # of the newest robot state and of the objects

    def corrections(self) -> dict[int, Correction]:
        """Weighted moments of the newest robot state and of the objects, against the Laplace Gaussian's."""
        problem = self.drawn.problem
        slopes = problem.newest_slopes(self.y[None])[0]  # (K, w, size)
        covariances = slopes @ np.linalg.solve(self.hessian, np.swapaxes(slopes, 1, 2))
        mode = WindowSamples(problem, self.y[None]).states[0]
        corrections: list[Correction] = []
        for space, rows in problem.spaces.kinds(len(mode)):
            s, d = space.storage_size, space.tangent_size
            moments = (mode[rows, :s], covariances[rows, :d, :d], self.drawn.states[:, rows, :s])
            corrections += Correction.towards(space, *moments, self.weights)
        return dict(zip(self.keys, corrections, strict=True))
