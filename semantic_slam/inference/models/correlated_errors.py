"""Correlated detection errors: shared by neighbours in one frame, and repeated in the next views of the same place.

In whitened coordinates the error of a detection's [range, bearing] is sqrt(s) f + sqrt(1 - s) w: w is white, and f,
standard normal in each component, is a Gaussian process over viewing geometry with

    Cov(f_i, f_j) = rho (c + (1 - c) exp(-|p_i - p_j|^2 / (2 l^2))),

where p are places relative to the robot (:func:`lasting_places`), c the share that a whole frame has in common
(heading, clock, scale of ranges), and rho = exp(-metres / m - radians / a) decays with the motion between two frames:
Gauss-Markov along the drive. A robot at rest thus learns a place no better than the variance of f allows. The state
that passes from frame to frame is f at the places of the newest detections and at those detected shortly before, for
detectors miss things: exact for as long as these are kept (``MOST_UNSEEN``, ``LEAST_LEFT``).

Constant sensor errors, a range offset and a yaw of the mount, persist: with g ~ N(0, I) in units of their standard
deviations, H_i g is added to f_i. g is a further entry behind those of the detections, and drifts as the biases of
odometry do.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.models.observation import Linearisation
from semantic_slam.inference.models.odometry_bias import CHANGE
from semantic_slam.inference.states.keys import STRETCH, VECTOR_SIZES, letter_of, vector_parts
from semantic_slam.inference.states.propagated_errors import PropagatedErrors

OWN_SHARE = 1e-4
"""Share of the variance of f that no two detections share: keeps covariances regular where two coincide."""
LEAST_SHARE = 1e-3
"""Share s of the variance from which on ``OWN_SHARE`` is that of f. Where a smaller s is beside constant sensor errors,
f has as much of its own as with this s: what is g's, which grows with 1 / sqrt(s), could otherwise not be told from
what is f's in double precision."""
CHANGE_OF_SENSOR = CHANGE / np.sqrt(STRETCH)
"""Standard deviation of the change of g from one frame to the next."""
SAME_PLACE = 16.0
"""Squared Mahalanobis distance in range and bearing below which a detection may be at a place of a frame before."""
MOST_UNSEEN = 8
"""Largest number of places that are propagated though a frame has no detection there."""
LEAST_LEFT = 0.1
"""Correlation with its last detection below which an unseen place is no longer propagated."""


def sensor_sigmas(settings: DetectionErrorsConfiguration) -> Array:
    """(2,) prior standard deviations [m, rad] of the constant sensor errors; (0,) where there are none."""
    sigmas = np.array([settings.sigma_range_offset_m, settings.sigma_yaw_rad])
    return sigmas if sigmas.any() else sigmas[:0]


def share_of(settings: DetectionErrorsConfiguration) -> float:
    """Share s of the variance of an error that f has; beside constant sensor errors a little more than a tiny s."""
    share = settings.correlated_share
    return share + OWN_SHARE * (_regular_share(settings) - share)


def own_share(settings: DetectionErrorsConfiguration) -> float:
    """Share of the variance of f that is of a single detection, neither of its neighbours nor of later ones."""
    return OWN_SHARE * (_regular_share(settings) / share_of(settings))


def _regular_share(settings: DetectionErrorsConfiguration) -> float:
    """Share of which f has ``OWN_SHARE`` of its own."""
    share = settings.correlated_share
    return max(share, LEAST_SHARE) if share > 0.0 and len(sensor_sigmas(settings)) else share


def sensor_slopes(settings: DetectionErrorsConfiguration, detections: Sequence[Any]) -> Array:
    """H (2 D, 2), Jacobian of the f of D detections by the constant sensor errors; (2 D, 0) where there are none."""
    sigmas = sensor_sigmas(settings)
    if not len(sigmas):
        return np.zeros((2 * len(detections), 0))
    whiten = np.array([own.whiten for own in detections]).reshape(-1, 2)
    return np.asarray(whiten * sigmas / np.sqrt(share_of(settings)))


def correlation(settings: DetectionErrorsConfiguration, one: Array, other: Array) -> Array:
    """(2 n, 2 m) covariance of f between places (n, 2) and (m, 2) [m], less the own; range and bearing interleaved."""
    squared = ((one[:, None] - other[None]) ** 2).sum(axis=-1)
    near = np.exp(-0.5 * squared / settings.neighbour_m**2)
    found = np.zeros((len(one), 2, len(other), 2))
    for component, common in enumerate((settings.common_range_share, settings.common_bearing_share)):
        found[:, component, :, component] = common + (1.0 - common) * near
    return (1.0 - own_share(settings)) * found.reshape(2 * len(one), 2 * len(other))


def lasting_places(
    settings: DetectionErrorsConfiguration, earlier: PropagatedErrors | None, detections: Sequence[Any]
) -> tuple[Array, Index]:
    """(D, 2) places [m] of D detections in the body frame, for the kernel, which is over true places.

    What stands still has, relative to the robot, the place that its last detection had, moved by odometry. Detections
    are matched with these places one to one, and keep them except for the share of their errors that the motion has
    renewed: otherwise the white noise of a measured place would count as motion.

    Returns also the (U,) earlier places that no detection is at and that are propagated further, latest seen first.
    """
    places = np.array([own.place for own in detections])
    if earlier is None:
        return places, np.zeros(0, dtype=int)
    from scipy.optimize import linear_sum_assignment  # deferred: the import takes 0.2 s

    ranged = np.array([own.has_range for own in detections], dtype=bool)
    offsets = _polar(earlier.places)[None] - _polar(places)[:, None]
    offsets[..., 1] = wrap_angle(offsets[..., 1])
    whitened = offsets @ np.swapaxes([own.whiten for own in detections], 1, 2)
    renewed = 1.0 - settings.correlated_share * earlier.left  # white, or changed since
    squared = (whitened**2).sum(axis=-1) / (2.0 * renewed)
    squared[~ranged] = SAME_PLACE
    rows, columns = linear_sum_assignment(np.minimum(squared, SAME_PLACE))
    same = squared[rows, columns] < SAME_PLACE
    places[rows[same]] += earlier.left * (earlier.places[columns[same]] - places[rows[same]])
    unseen = earlier.left * earlier.left_of_each >= LEAST_LEFT
    unseen[columns[same]] = False
    return places, np.flatnonzero(unseen)[:MOST_UNSEEN]


def _polar(places: Array) -> Array:
    """(n, 2) range [m] and bearing [rad] of places (n, 2)."""
    return np.stack([np.hypot(places[:, 0], places[:, 1]), np.arctan2(places[:, 1], places[:, 0])], axis=1)


@dataclass(frozen=True)
class WhiteResidual:
    """Conversion of a residual whitened by the whole error to one whitened by the white part w alone."""

    settings: DetectionErrorsConfiguration

    @property
    def scale(self) -> float:
        """Factor on whitened residuals and their Jacobians."""
        return float(1.0 / np.sqrt(1.0 - share_of(self.settings)))

    @property
    def slope(self) -> float:
        """Derivative of the converted residual by f, in each component."""
        return float(np.sqrt(share_of(self.settings))) * self.scale

    def slopes(self, ranged: Flags) -> Array:
        """(D, 2) derivatives by f of the range and bearing residuals; 0 for a range that is not measured."""
        return self.slope * np.stack([ranged, np.ones_like(ranged)], axis=1)

    def linearisation(self, plain: Linearisation, slopes: Array, mean: Array) -> Linearisation:
        """B rows at f of ``mean`` (B, 2), from rows whitened by the whole error."""
        measured = (slopes > 0.0).sum(axis=1)
        return Linearisation(
            residual=self.scale * plain.residual + slopes * mean,
            jacobian_robot=self.scale * plain.jacobian_robot,
            jacobian_object=self.scale * plain.jacobian_object,
            log_normaliser=plain.log_normaliser + measured * float(np.log(self.scale)),
        )


def _repeated(
    settings: DetectionErrorsConfiguration, earlier: PropagatedErrors | None, places: Array
) -> tuple[Array, Array]:
    """A (2 D, 2 n) and Q (2 D, 2 D) of the process f alone, without constant sensor errors."""
    white = own_share(settings)
    own = correlation(settings, places, places) + white * np.eye(2 * len(places))
    if earlier is None:
        return np.zeros((len(own), 0)), own
    known = correlation(settings, earlier.places, earlier.places) + white * np.eye(2 * len(earlier.places))
    cross = earlier.left * correlation(settings, places, earlier.places)
    matrix = np.asarray(np.linalg.solve(known, cross.T).T, dtype=np.float64)
    noise = own - matrix @ cross.T
    return matrix, 0.5 * (noise + noise.T)


def _with_sensor(matrix: Array, noise: Array, now: Array, before: Array | None) -> tuple[Array, Array]:
    """A and Q of (f + H g, g) from those of f; H is ``now`` (2 D, d), and was ``before`` (2 n, d) in the last frame."""
    size = now.shape[1]
    if not size:
        return matrix, noise
    by_sensor = np.concatenate([now, np.eye(size)])
    variance = 1.0 if before is None else CHANGE_OF_SENSOR**2
    spread = variance * by_sensor @ by_sensor.T
    spread[: len(noise), : len(noise)] += noise
    if before is None:
        return np.zeros((len(spread), 0)), spread
    whole = np.zeros((len(spread), matrix.shape[1] + size))
    whole[: len(matrix), : matrix.shape[1]] = matrix
    whole[:, matrix.shape[1] :] = by_sensor
    whole[: len(matrix), matrix.shape[1] :] -= matrix @ before
    return whole, spread


@dataclass(frozen=True, kw_only=True)
class ErrorTransition:
    """Transition of f and g from n places to the m of a frame's detections, which come first, and of unseen ones.

    f_k = A f + v, v ~ N(0, Q); d is 2 with g, else 0. The vector (f, g) is (2 m + d,).
    """

    white: WhiteResidual
    before: int  # keyframe of the detections before
    matrix: Array  # A (2 m + d, 2 n + d)
    noise: Array  # Q (2 m + d, 2 m + d)
    mean: Array  # (2 m + d,) predicted
    places: Array  # (m, 2)
    by_sensor: Array  # H (2 m, d)
    left_of_each: Array  # (m,) correlation with the last detection at each place

    @classmethod
    def of(
        cls, settings: DetectionErrorsConfiguration, earlier: PropagatedErrors | None, detections: Sequence[Any]
    ) -> Self:
        """The transition to detections in the body frame; ``earlier`` is already expressed at the newest keyframe."""
        places, unseen = lasting_places(settings, earlier, detections)
        by_sensor, left = sensor_slopes(settings, detections), np.ones(len(detections))
        if earlier is not None:
            places = np.concatenate([places, earlier.places[unseen]])
            by_sensor = np.concatenate([by_sensor, earlier.slopes_at(unseen)])
            left = np.append(left, earlier.left * earlier.left_of_each[unseen])
        matrix, noise = _repeated(settings, earlier, places)
        matrix, noise = _with_sensor(matrix, noise, by_sensor, None if earlier is None else earlier.by_sensor)
        return cls(
            white=WhiteResidual(settings),
            before=-1 if earlier is None else earlier.keyframe,
            matrix=matrix,
            noise=noise,
            mean=np.zeros(len(matrix)) if earlier is None else matrix @ earlier.mean,
            places=places,
            by_sensor=by_sensor,
            left_of_each=left,
        )

    @property
    def count(self) -> int:
        """Number of entries, of two components each."""
        return len(self.mean) // 2

    def after(self, keyframe: int, mean: Array) -> PropagatedErrors:
        """The errors of this frame, ``keyframe``, with this ``mean``."""
        return PropagatedErrors(
            keyframe=keyframe,
            places=self.places,
            by_sensor=self.by_sensor,
            left_of_each=self.left_of_each,
            mean=mean,
        )

    def factor(self, before: Sequence[int], now: Sequence[int]) -> Any:
        """GTSAM factor of the transition, on the variables that hold the errors at n and at m places."""
        inverse = solve_triangular(np.linalg.cholesky(self.noise), np.eye(len(self.noise)), lower=True)
        whole = np.concatenate([-inverse @ self.matrix, inverse], axis=1)
        keys = [*before, *now]
        blocks = [np.asfortranarray(whole[:, part]) for part in vector_parts(keys)]

        def at_origin(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
            if jacobians is not None:
                for at, block in enumerate(blocks):
                    jacobians[at] = block
            return np.zeros(len(whole))

        origin = gtsam.Values()
        for key in keys:
            origin.insert(key, np.zeros(VECTOR_SIZES[letter_of(key)]))
        callback = gtsam.CustomFactor(unit_noise(len(whole)), keys, at_origin)
        # A linear container, as GTSAM would copy all values of its graph for every callback.
        return gtsam.LinearContainerFactor(callback.linearize(origin), origin)


@dataclass(frozen=True, kw_only=True)
class PredictedErrors:
    """Predicted f of a frame's D detections, with its covariance to the robot and M objects (r + M l coordinates)."""

    transition: ErrorTransition
    slopes: Array  # (D, 2) derivatives of the residuals
    covariance: Array  # (2 m + d, 2 m + d)
    cross: Array  # (r + M l, 2 m + d) with robot and objects

    @property
    def mean(self) -> Array:
        """(D, 2) expected f."""
        return self.transition.mean.reshape(-1, 2)[: len(self.slopes)]

    def rows(self, numbers: Sequence[int]) -> Index:
        """Rows of the components of some detections."""
        return (2 * np.asarray(numbers, dtype=int)[:, None] + np.arange(2)).ravel()

    def with_pairs(self, pairs: Array, rows: Index) -> Array:
        """(D, M, r + l + 2, r + l + 2) joint covariance of robot, each object and each detection's f.

        ``pairs`` (M, r + l, r + l): that of robot and object. ``rows`` (M, r + l): their rows in ``cross``.
        """
        count, size = len(self.slopes), pairs.shape[-1]
        own = slice(2 * count)
        blocks = self.covariance[own, own].reshape(count, 2, count, 2)[np.arange(count), :, np.arange(count)]
        found = np.empty((count, len(pairs), size + 2, size + 2))
        found[..., :size, :size] = pairs
        found[..., size:, size:] = blocks[:, None]
        cross = np.moveaxis(self.cross[rows][..., own].reshape(len(pairs), size, count, 2), 2, 0)
        found[..., :size, size:] = cross
        found[..., size:, :size] = np.swapaxes(cross, -1, -2)
        return found
