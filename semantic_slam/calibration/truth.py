"""Comparison of a calibration with ground truth, where the bag has it; for reporting only."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from semantic_slam.calibration.calibrate import Calibration
from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.evaluation.evaluate import evaluate
from semantic_slam.evaluation.record import GroundTruth, Record
from semantic_slam.evaluation.trajectory import Trajectory, interpolate
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.models.noise.odometry_noise import odometry_covariance
from semantic_slam.inference.models.odometry_bias import NAMES, slopes
from semantic_slam.messages.standard import NANOSECONDS

LARGEST_OFFSET_S = 0.5
"""Largest clock offset [s] between odometry and detections, in either direction, that is searched."""


@dataclass(frozen=True)
class TrueBias:
    """One systematic odometry error: true and inferred value."""

    name: str  # as the configuration names it
    true: float  # least squares against the true trajectory
    inferred: float  # NaN: it was not estimated
    sigma: float

    @property
    def off(self) -> float:
        """Error of the inferred value in standard deviations."""
        return (self.inferred - self.true) / self.sigma


@dataclass(frozen=True)
class Figures:
    """Error figures of one run against ground truth."""

    ate_aligned_m: float
    nees: float  # 3 when consistent
    odometry_error: float  # RMS odometry error after bias removal, relative to the stated one; 1 when consistent


@dataclass(frozen=True)
class TruthBeside:
    """Figures before and after calibration, against ground truth."""

    before: Figures
    after: Figures
    biases: tuple[TrueBias, ...]


def truth_beside(found: Calibration) -> TruthBeside | None:
    """Compare with ground truth; None where the bag has no true trajectory."""
    truth = found.record_after.truth
    if truth is None or not len(truth.trajectory):
        return None
    motions = Motions.of(found.record_after, truth)
    if len(motions.true) < 2:
        return None

    def figures(record: Record, settings: OdometryConfiguration) -> Figures:
        metrics = {name: np.nan if value is None else value for name, value in evaluate(record, truth).metrics.items()}
        return Figures(metrics["ate_aligned_m"], metrics["nees_mean"], motions.fitted(settings)[1])

    bias, _ = motions.fitted(found.after.odometry)
    told = [found.last.noise.get(name, (np.nan, np.nan)) for name in NAMES]
    return TruthBeside(
        before=figures(found.record_before, found.before.odometry),
        after=figures(found.record_after, found.after.odometry),
        biases=tuple(TrueBias(name, true, *own) for name, true, own in zip(NAMES, bias.tolist(), told, strict=True)),
    )


@dataclass(frozen=True)
class Motions:
    """K odometry motions between keyframes, with the true ones."""

    odometry: Trajectory
    stamps_ns: NDArray[np.int64]  # (K, 2) of their beginnings and ends
    true: Array  # (K, 3)

    @classmethod
    def of(cls, record: Record, truth: GroundTruth) -> Self:
        """Motions of a record for which odometry and ground truth are known."""
        stamps = np.array([belief.stamp_ns for belief in record.beliefs], dtype=np.int64)
        pairs = np.stack([stamps[:-1], stamps[1:]], axis=1)
        known = np.isfinite(motions(truth.trajectory, pairs)).all(axis=1)
        for offset in (-LARGEST_OFFSET_S, LARGEST_OFFSET_S):
            known &= np.isfinite(motions(record.odometry, shifted(pairs, offset))).all(axis=1)
        return cls(record.odometry, pairs[known], motions(truth.trajectory, pairs[known]))

    def fitted(self, settings: OdometryConfiguration) -> tuple[Array, float]:
        """(4,) least-squares biases, and the RMS residual relative to the stated standard deviations."""
        best = min(np.linspace(-1.0, 1.0, 21), key=lambda share: self._at(share * LARGEST_OFFSET_S, settings)[1])
        near = np.clip([best - 0.1, best + 0.1], -1.0, 1.0) * LARGEST_OFFSET_S
        offset = float(minimize_scalar(lambda t: self._at(t, settings)[1], bounds=near, method="bounded").x)
        bias, left = self._at(offset, settings)
        return np.append(bias, offset), left

    def _at(self, offset_s: float, settings: OdometryConfiguration) -> tuple[Array, float]:
        """(3,) biases for a given clock offset, and the RMS residual."""
        controls = motions(self.odometry, shifted(self.stamps_ns, offset_s))
        stated = [odometry_covariance(float(np.hypot(x, y)), abs(float(yaw)), settings) for x, y, yaw in controls]
        deviations = np.sqrt(np.diagonal(stated, axis1=1, axis2=2))
        errors = se2.log(se2.between(controls, self.true)) / deviations
        by_bias = slopes(controls) / deviations[..., None]
        solution = np.linalg.lstsq(by_bias.reshape(-1, by_bias.shape[-1]), errors.ravel(), rcond=None)
        bias = np.asarray(solution[0], dtype=np.float64)
        return bias, float(np.sqrt(((errors - by_bias @ bias) ** 2).mean()))


def motions(path: Trajectory, stamps_ns: NDArray[np.int64]) -> Array:
    """(K, 3) planar motions along a path between (K, 2) instants; NaN beyond its time."""
    first, last = (interpolate(path, stamps_ns[:, column]) for column in (0, 1))
    known = np.isfinite(first).all(axis=1) & np.isfinite(last).all(axis=1)
    found = np.full((len(stamps_ns), 3), np.nan)
    found[known] = se2.between(planar_from_pose_vector(first[known]), planar_from_pose_vector(last[known]))
    return found


def shifted(stamps_ns: NDArray[np.int64], offset_s: float) -> NDArray[np.int64]:
    """Stamps shifted later by ``offset_s``."""
    return np.asarray(stamps_ns + round(offset_s * NANOSECONDS), dtype=np.int64)
