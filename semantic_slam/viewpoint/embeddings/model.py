"""What vectors of appearance tell of whether views show one object, before anybody has fitted anything.

The views of an object spread about its mean direction, and objects about that of the background: on the tangent of
the unit sphere at the latter, of the spread E|x - m|^2 of all vectors, a share s is that of an object's sides, which
change smoothly with the place of view, n is each view's own, and the rest that of objects:

    x_i = m + u + v_i,    Cov[x_i, x_j] = (1 - s - n) + s k_ij + n [i = j],
    k_ij = exp((cos a_ij - 1) / r^2 - l_ij^2 / (2 r^2)),

with the turn a_ij about the object and the change l_ij of the logarithm of the distance (a Gaussian process on circle
and line: smooth, so that views from one side alone tell little of how different the other sides are). Near-identical
views so repeat themselves. All is even over the background's nu dimensions. The predictive density of a next view is
exact, and stated relative to that of the background, so that the first view of a new object, and a false alarm, have
the log ratio 0. A view is an outlier with probability e, and then like the background: no single one decides all.

Every object has its own s and n, out of a few settings. How usual these are is shared by all objects and learned from
them: Dirichlet, by the probabilities that the objects' views give the settings. With outliers the posterior is not of
one Gaussian: a view counts as far as it is none (assumed-density filtering). This is Gaussian probabilistic linear
discriminant analysis on vectors of length one (Garcia-Romero, Espy-Wilson 2011), with correlated views.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground

NUM_SECTORS = 24
"""Around an object: its newest view from each is remembered."""
REMEMBERED_RAD = 2.0 * np.pi / NUM_SECTORS
SHARED_COUNTS = 1.0
"""Objects that count for all settings alike, before any object was seen."""
LEAST_INLIER = 0.05
"""Probability of being no outlier below which a view is not remembered."""


@dataclass(frozen=True, kw_only=True)
class EmbeddingModel:
    """P(vectors of an object's views) relative to the background; R settings, L components."""

    dimensions: int  # L
    spread_shares: tuple[float, ...]  # s
    noise_shares: tuple[float, ...]  # n
    repeat_rad: float  # r
    outlier_share: float  # e
    shared_counts: tuple[float, ...] = ()  # (R,) objects that count for each setting before any was seen; (): alike

    @cached_property
    def settings(self) -> tuple[Array, Array]:
        """(R,) shares s and n of each setting."""
        s, n = np.meshgrid(self.spread_shares, self.noise_shares, indexing="ij")
        return s.ravel(), n.ravel()

    @cached_property
    def within(self) -> Array:
        """(R,) shares of the views of one object, about its mean direction."""
        return self.settings[0] + self.settings[1]

    @property
    def space(self) -> str:
        """Name of the space that mean directions are stated in."""
        return f"embedding-{self.dimensions}"

    def start(self, mean: Array | None = None, spread: float = 0.0) -> "EmbeddingRecord":
        """Nothing seen yet; ``mean`` (L,) with its expected squared error ``spread``: what a map knows."""
        size = len(self.settings[0])
        return EmbeddingRecord(
            model=self, log_settings=np.zeros(size), told_settings=np.zeros(size), mean=mean, mean_spread=spread
        )

    def usual(self, told: Array) -> Array:
        """(R,) log probabilities of the settings of an object, from the sum (R,) of what the others' views tell."""
        before = np.array(self.shared_counts) if self.shared_counts else SHARED_COUNTS / len(told)
        counts = before + np.maximum(told, 0.0)
        return np.asarray(np.log(counts / counts.sum()))

    def evidence(self, record: "EmbeddingRecord", log_ratios: Array, usual: Array) -> float:
        """Log density of a view relative to the background, from its (R,) log ratios under the settings."""
        before = usual + record.log_settings
        return float(finite_log_sum_exp(before + self.with_outliers(log_ratios)) - finite_log_sum_exp(before))

    def with_outliers(self, log_ratios: Array) -> Array:
        """Log of (1 - e) exp(ratio) + e."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.logaddexp(np.log1p(-self.outlier_share) + log_ratios, np.log(self.outlier_share)))

    def kernel(self, turned: Array, away: Array) -> Array:
        """(R, ...) covariance of two views over the spread, but for their own noise, from turns and log distances."""
        s = self.settings[0].reshape(-1, *(1,) * turned.ndim)
        return np.asarray(s * np.exp((np.cos(turned) - 1.0 - 0.5 * away**2) / self.repeat_rad**2))


@dataclass(frozen=True, kw_only=True, eq=False)
class EmbeddingRecord:
    """The views of one object that later ones are compared with, N of them, oldest first."""

    model: EmbeddingModel
    log_settings: Array  # (R,) log likelihood of all views, relative to the background
    told_settings: Array  # (R,) their posterior; 0 while there are no two views
    vectors: tuple[Array, ...] = ()  # N of (L,)
    directions: Array = field(default_factory=lambda: np.zeros(0))  # (N,) from the object to the camera, radians in map
    log_ranges: Array = field(default_factory=lambda: np.zeros(0))  # (N,) log of the distance in metres
    doubts: Array = field(default_factory=lambda: np.zeros(0))  # (N,) odds that they are outliers
    num_views: int = 0
    background: EmbeddingBackground | None = None  # at the newest view
    mean: Array | None = None  # (L,) mean direction as a map has it, None: as the background
    mean_spread: float = 0.0  # expected squared error of that

    def log_ratios(self, vector: Array, background: EmbeddingBackground, directions: Array, log_ranges: Array) -> Array:
        """(R, M) log densities of an (L,) vector seen from (M,) directions and log distances, to the background's."""
        centre, share = self._prior_mean(background)
        from_centre = vector - background.centre
        squared = float(from_centre @ from_centre)
        if not self.vectors:
            off = vector - centre
            distance = np.full((len(share), len(directions)), float(off @ off))
            variance = (share + self.model.within)[:, None] + np.zeros(len(directions))
        else:
            distance, variance = self._predicted(vector, background, directions, log_ranges)
        scaled = distance / variance - squared
        return np.asarray(-0.5 * background.dimensions * (scaled / background.spread + np.log(variance)))

    def after(
        self,
        vector: Array,
        log_ratios: Array,
        usual: Array,
        background: EmbeddingBackground,
        direction: float,
        log_range: float,
    ) -> "EmbeddingRecord":
        """With one more view, whose (R,) log ratios are those from its direction and log distance."""
        likelihood = self.model.with_outliers(log_ratios)
        log_settings = self.log_settings + likelihood
        posterior = np.exp(usual + log_settings - finite_log_sum_exp(usual + log_settings))
        inlier = float(posterior @ np.exp(np.log1p(-self.model.outlier_share) + log_ratios - likelihood))
        seen = replace(
            self,
            log_settings=log_settings,
            told_settings=posterior if self.num_views or self.mean is not None else self.told_settings,
            num_views=self.num_views + 1,
            background=background,
        )
        return seen._remembering(vector, direction, log_range, inlier) if inlier >= LEAST_INLIER else seen

    def usual_log_ranges(self, directions: Array) -> Array:
        """(M,) log distances of the views from the sides nearest to (M,) directions; 0 without views."""
        if not self.vectors:
            return np.zeros(len(directions))
        nearest = np.abs(_turns(self.directions[:, None] - directions)).argmin(axis=0)
        return np.asarray(self.log_ranges[nearest])

    def mean_direction(self) -> tuple[Array, float]:
        """(L,) posterior mean of the mean direction, and its expected squared error; NaN before the first view."""
        if self.background is None:
            unknown = np.full(self.model.dimensions, np.nan), np.nan
            return unknown if self.mean is None else (self.mean, self.mean_spread)
        centre, share = self._prior_mean(self.background)
        off = np.array(self.vectors).reshape(-1, len(centre)) - centre
        gains = share[:, None] * self._inverse(self.background).sum(axis=2)  # (R, N)
        weights = np.exp(self.log_settings - finite_log_sum_exp(self.log_settings))
        means, mean = gains @ off, weights @ gains @ off
        errors = share * (1.0 - gains.sum(axis=1)) * self.background.spread + ((means - mean) ** 2).sum(axis=1)
        return centre + mean, float(weights @ errors)

    def _remembering(self, vector: Array, direction: float, log_range: float, inlier: float) -> "EmbeddingRecord":
        """With a view, in place of one from the same sector."""
        sectors = np.rint(np.append(self.directions, direction) / REMEMBERED_RAD) % NUM_SECTORS
        kept = np.flatnonzero(sectors[:-1] != sectors[-1])
        return replace(
            self,
            vectors=(*(self.vectors[row] for row in kept), vector),
            directions=np.append(self.directions[kept], direction),
            log_ranges=np.append(self.log_ranges[kept], log_range),
            doubts=np.append(self.doubts[kept], (1.0 - inlier) / inlier),
        )

    def _prior_mean(self, background: EmbeddingBackground) -> tuple[Array, Array]:
        """(L,) expected mean direction before any view, and (R,) its variance over the spread."""
        most = 1.0 - self.model.within
        if self.mean is None:
            return background.centre, most
        return self.mean, np.minimum(most, self.mean_spread / background.spread)

    def _predicted(
        self, vector: Array, background: EmbeddingBackground, directions: Array, log_ranges: Array
    ) -> tuple[Array, Array]:
        """(R, M) squared distances of a vector from what is predicted, and the variances over the spread."""
        centre, share = self._prior_mean(background)
        turned = _turns(self.directions[:, None] - directions)  # (N, M)
        shared = share[:, None, None] + self.model.kernel(turned, self.log_ranges[:, None] - log_ranges)  # (R, N, M)
        gains = self._inverse(background) @ shared
        variance = (share + self.model.within)[:, None] - (gains * shared).sum(axis=1)
        off, own = np.array(self.vectors) - centre, vector - centre
        along, across = np.einsum("rnm,n->rm", gains, off @ own), ((off @ off.T) @ gains * gains).sum(axis=1)
        return np.maximum(float(own @ own) - 2.0 * along + across, 0.0), np.asarray(variance)

    def _inverse(self, background: EmbeddingBackground) -> Array:
        """(R, N, N) of the covariance of the views over the spread."""
        _, share = self._prior_mean(background)
        return self._inverse_of_views if self.mean is None else np.asarray(np.linalg.inv(self._covariance(share)))

    @cached_property
    def _inverse_of_views(self) -> Array:
        return np.asarray(np.linalg.inv(self._covariance(1.0 - self.model.within)))

    def _covariance(self, share: Array) -> Array:
        """(R, N, N); what may be an outlier errs by more, in units of all spread."""
        turned = _turns(self.directions[:, None] - self.directions)
        smooth = self.model.kernel(turned, self.log_ranges[:, None] - self.log_ranges)
        own = self.model.settings[1][:, None] + self.doubts
        return np.asarray(share[:, None, None] + smooth + own[..., None] * np.eye(len(self.doubts)))


def _turns(angles: Array) -> Array:
    """Angles within a half turn."""
    return np.asarray((angles + np.pi) % (2.0 * np.pi) - np.pi)
