"""Embedding likelihood: whether views show one object, by their appearance vectors, without any training.

The views of an object spread around its mean direction u, and objects spread around the background mean m, in the
tangent space of the unit sphere at m. Of the total variance E|x - m|^2, a share s is variation between an object's
sides, which changes smoothly with the viewpoint, a share n is noise of single views, and the rest is variation between
objects:

    x_i = m + u + v_i,    Cov[x_i, x_j] = (1 - s - n) + s k_ij + n [i = j],
    k_ij = exp((cos a_ij - 1) / r^2 - l_ij^2 / (2 r^2)),

where a_ij is the angle between the views about the object and l_ij the change of log distance (a Gaussian process on
circle x line, in space on sphere x line; it is smooth, so views from one side say little about the other sides).
Near-identical views are thus correlated rather than independent evidence. All covariances are isotropic over the
background's nu dimensions. The predictive density of the next view is exact and stated relative to that of the
background, so that the first view of a new object, and a false alarm, have log ratio 0. A view is an outlier with
probability e and is then distributed as the background: no single view decides everything.

Every object has its own s and n, out of R settings. The frequencies of the settings are shared by all objects and
learned from them: a Dirichlet updated with each object's posterior over the settings. With outliers the posterior is
not one Gaussian, so a view counts by its inlier probability (assumed-density filtering). The model is Gaussian
probabilistic linear discriminant analysis (PLDA) on unit vectors (Garcia-Romero, Espy-Wilson 2011), with correlated
views.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces

NUM_SECTORS = 24
"""Number of azimuth sectors around an object; its newest view from each, and from each height, is remembered."""
REMEMBERED_RAD = 2.0 * np.pi / NUM_SECTORS
SHARED_COUNTS = 1.0
"""Dirichlet pseudo-count of objects, spread evenly over the settings, before any object was seen."""
LEAST_INLIER = 0.05
"""Inlier probability below which a view is not remembered."""


@dataclass(frozen=True, kw_only=True)
class EmbeddingModel:
    """Likelihood of an object's view vectors relative to the background; R settings, L components."""

    dimensions: int  # L
    spread_shares: tuple[float, ...]  # s
    noise_shares: tuple[float, ...]  # n
    repeat_rad: float  # r
    outlier_share: float  # e
    shared_counts: tuple[float, ...] = ()  # (R,) prior pseudo-count of objects per setting; (): even

    @cached_property
    def settings(self) -> tuple[Array, Array]:
        """(R,) variance shares s and (R,) n of the settings."""
        s, n = np.meshgrid(self.spread_shares, self.noise_shares, indexing="ij")
        return s.ravel(), n.ravel()

    @cached_property
    def within(self) -> Array:
        """(R,) shares s + n of the variance of one object's views around its mean direction."""
        return self.settings[0] + self.settings[1]

    @property
    def space(self) -> str:
        """Name of the space that mean directions are stated in."""
        return f"embedding-{self.dimensions}"

    def start(self, mean: Array | None = None, spread: float = 0.0) -> "EmbeddingRecord":
        """Empty record; ``mean`` (L,), with its expected squared error ``spread``, is the prior from a map."""
        size = len(self.settings[0])
        return EmbeddingRecord(
            model=self,
            log_settings=np.zeros(size),
            told_settings=np.zeros(size),
            mean=mean,
            mean_spread=spread,
        )

    def usual(self, told: Array) -> Array:
        """(R,) log prior of an object's settings, from the sum (R,) of the other objects' posteriors."""
        before = np.array(self.shared_counts) if self.shared_counts else SHARED_COUNTS / len(told)
        counts = before + np.maximum(told, 0.0)
        return np.asarray(np.log(counts / counts.sum()))

    def evidence(self, record: "EmbeddingRecord", log_ratios: Array, usual: Array) -> float:
        """Log density of a view relative to the background, from its (R,) log ratios under the settings."""
        before = usual + record.log_settings
        return float(finite_log_sum_exp(before + self.with_outliers(log_ratios)) - finite_log_sum_exp(before))

    def with_outliers(self, log_ratios: Array) -> Array:
        """Log ratios with outliers mixed in: log of (1 - e) exp(ratio) + e."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.logaddexp(np.log1p(-self.outlier_share) + log_ratios, np.log(self.outlier_share)))

    def kernel(self, first: CameraPlaces, second: CameraPlaces) -> Array:
        """(R, N, M) covariance s k_ij of views from two sets of places relative to the spread, without noise."""
        cosines, away = first.apart(second)
        alike = np.exp((cosines - 1.0 - 0.5 * away**2) / self.repeat_rad**2)
        return np.asarray(self.settings[0][:, None, None] * alike)


@dataclass(frozen=True, kw_only=True, eq=False)
class EmbeddingRecord:
    """Remembered views of one object, N of them, oldest first, with which later views are compared."""

    model: EmbeddingModel
    log_settings: Array  # (R,) log likelihood of all views, relative to the background
    told_settings: Array  # (R,) posterior of the settings; 0 while there are fewer than two views
    vectors: tuple[Array, ...] = ()  # N of (L,)
    places: CameraPlaces = field(default_factory=CameraPlaces.none)  # N
    doubts: Array = field(default_factory=lambda: np.zeros(0))  # (N,) odds that the views are outliers
    num_views: int = 0
    background: EmbeddingBackground | None = None  # as of the newest view
    mean: Array | None = None  # (L,) prior mean direction from a map; None: the background's
    mean_spread: float = 0.0  # expected squared error of ``mean``

    def log_ratios(self, vector: Array, background: EmbeddingBackground, places: CameraPlaces) -> Array:
        """(R, M) log density ratios to the background of an (L,) vector seen from M places."""
        centre, share = self._prior_mean(background)
        from_centre = vector - background.centre
        squared = float(from_centre @ from_centre)
        if not self.vectors:
            off = vector - centre
            distance = np.full((len(share), len(places)), float(off @ off))
            variance = (share + self.model.within)[:, None] + np.zeros(len(places))
        else:
            distance, variance = self._predicted(vector, background, places)
        scaled = distance / variance - squared
        return np.asarray(-0.5 * background.dimensions * (scaled / background.spread + np.log(variance)))

    def after(
        self, vector: Array, log_ratios: Array, usual: Array, background: EmbeddingBackground, place: CameraPlaces
    ) -> "EmbeddingRecord":
        """Record with one more view from one place, given its (R,) :meth:`log_ratios` there."""
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
        return seen._remembering(vector, place, inlier) if inlier >= LEAST_INLIER else seen

    def usual_places(self, azimuths_rad: Array) -> CameraPlaces:
        """Places at (M,) azimuths, as high and as far away as the remembered view with the nearest azimuth.

        Level and at one metre without views.
        """
        if not self.vectors:
            return CameraPlaces.level(azimuths_rad)
        nearest = np.abs(wrap_angle(self.places.azimuths_rad[:, None] - azimuths_rad)).argmin(axis=0)
        return replace(self.places.take(nearest), azimuths_rad=azimuths_rad)

    def mean_direction(self, usual: Array) -> tuple[Array, float]:
        """(L,) posterior mean of the mean direction, and its expected squared error; NaN before the first view.

        ``usual`` (R,): log prior of the settings, see :meth:`EmbeddingModel.usual`.
        """
        if self.background is None:
            unknown = np.full(self.model.dimensions, np.nan), np.nan
            return unknown if self.mean is None else (self.mean, self.mean_spread)
        centre, share = self._prior_mean(self.background)
        off = np.array(self.vectors).reshape(-1, len(centre)) - centre
        gains = share[:, None] * self._inverse(self.background).sum(axis=2)  # (R, N)
        log_weights = usual + self.log_settings
        weights = np.exp(log_weights - finite_log_sum_exp(log_weights))
        means, mean = gains @ off, weights @ gains @ off
        errors = share * (1.0 - gains.sum(axis=1)) * self.background.spread + ((means - mean) ** 2).sum(axis=1)
        return centre + mean, float(weights @ errors)

    def _remembering(self, vector: Array, place: CameraPlaces, inlier: float) -> "EmbeddingRecord":
        """Record with a view added, which replaces an earlier one from the same sector and height."""
        here = (self.places.cells(REMEMBERED_RAD) == place.cells(REMEMBERED_RAD)).all(axis=1)
        kept = np.flatnonzero(~here)
        return replace(
            self,
            vectors=(*(self.vectors[row] for row in kept), vector),
            places=self.places.take(kept).with_place(place),
            doubts=np.append(self.doubts[kept], (1.0 - inlier) / inlier),
        )

    def _prior_mean(self, background: EmbeddingBackground) -> tuple[Array, Array]:
        """(L,) prior of the mean direction, and (R,) its variance relative to the spread."""
        most = 1.0 - self.model.within
        if self.mean is None:
            return background.centre, most
        return self.mean, np.minimum(most, self.mean_spread / background.spread)

    def _predicted(self, vector: Array, background: EmbeddingBackground, places: CameraPlaces) -> tuple[Array, Array]:
        """(R, M) squared distances of a vector to its prediction, and predictive variances relative to the spread."""
        centre, share = self._prior_mean(background)
        shared = share[:, None, None] + self.model.kernel(self.places, places)  # (R, N, M)
        gains = self._inverse(background) @ shared
        variance = (share + self.model.within)[:, None] - (gains * shared).sum(axis=1)
        off, own = np.array(self.vectors) - centre, vector - centre
        along, across = np.einsum("rnm,n->rm", gains, off @ own), ((off @ off.T) @ gains * gains).sum(axis=1)
        return np.maximum(float(own @ own) - 2.0 * along + across, 0.0), np.asarray(variance)

    def _inverse(self, background: EmbeddingBackground) -> Array:
        """(R, N, N) inverse covariance of the views, relative to the spread."""
        _, share = self._prior_mean(background)
        return self._inverse_of_views if self.mean is None else np.asarray(np.linalg.inv(self._covariance(share)))

    @cached_property
    def _inverse_of_views(self) -> Array:
        return np.asarray(np.linalg.inv(self._covariance(1.0 - self.model.within)))

    def _covariance(self, share: Array) -> Array:
        """(R, N, N) covariance of the views relative to the spread; possible outliers have inflated noise."""
        smooth = self.model.kernel(self.places, self.places)
        own = self.model.settings[1][:, None] + self.doubts
        return np.asarray(share[:, None, None] + smooth + own[..., None] * np.eye(len(self.doubts)))
