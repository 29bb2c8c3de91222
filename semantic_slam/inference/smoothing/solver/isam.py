"""GTSAM's iSAM2 as configured here, and its single owner."""

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.errors import ConsumedSmootherError
from semantic_slam.inference.states.keys import DESCRIPTOR, VECTOR_SIZES
from semantic_slam.inference.states.spaces import Spaces

WILDFIRE_THRESHOLD = 1e-9
"""Change below which back-substitution stops; so small that estimates solve the whole system."""
STEPPED_SKIP, STEPPED_WILDFIRE = 10, 5e-3
"""Where updates are not iterated: keyframes between relinearisations, and change [m or rad] below which
back-substitution stops."""
AT_ONCE = 2.0
"""With correlated detection errors: distance of the robot's mode from the odometry prediction, in relinearisation
thresholds, from which on all is relinearised at once. Otherwise the next keyframes would be weighed as if the loop had
not closed."""
NEVER = 1 << 30
"""Updates between relinearisations where measurements are linear in fixed charts: iSAM2 itself relinearises nothing."""
ALONG_RAYS = 0.1
"""Share of the usual relinearisation thresholds once an object is seen by a ray alone: its range is far from linear. At
the usual ones, histories of a walk among thirty things were weighed up to 60 nats apart from a converged estimate."""
STIFF_WILDFIRE = 1e-3
"""Back-substitution threshold with correlated detection errors: the white part of an error is a third of the whole."""


class OwnedIsam:
    """An iSAM2 that a single smoother at a time reads and updates."""

    def __init__(self, isam: gtsam.ISAM2) -> None:
        self._isam: gtsam.ISAM2 | None = isam

    @property
    def isam(self) -> gtsam.ISAM2:
        """The iSAM2. Raises ConsumedSmootherError once it was handed on."""
        if self._isam is None:
            raise ConsumedSmootherError("this smoother was consumed by its update; fork() it before, to keep it")
        return self._isam

    def fork(self) -> "OwnedIsam":
        """A copy of the iSAM2, for another owner."""
        return OwnedIsam(gtsam.ISAM2(self.isam))

    def hand_on(self) -> "OwnedIsam":
        """The iSAM2 moved to a new owner; this one raises from now on."""
        other, self._isam = OwnedIsam(self.isam), None
        return other


def new_isam(
    spaces: Spaces, descriptor_threshold: Array, factorization: str = "CHOLESKY", *, fineness: float = 1.0
) -> gtsam.ISAM2:
    """An empty iSAM2 that relinearises at every update; (L,) thresholds for descriptors where there are any.

    ``fineness``: share of the usual thresholds of states, see ``ALONG_RAYS``.
    """
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization(factorization)
    parameters.relinearizeSkip = 1
    thresholds = gtsam.ISAM2ThresholdMap()
    for symbol, space in (("x", spaces.robot), ("o", spaces.landmark)):
        thresholds.insert((symbol, fineness * space.relinearize_threshold))
    if len(descriptor_threshold):
        thresholds.insert((DESCRIPTOR, descriptor_threshold))
    parameters.setRelinearizeThreshold(thresholds)
    solver = gtsam.ISAM2GaussNewtonParams()
    solver.setWildfireThreshold(WILDFIRE_THRESHOLD)
    parameters.setOptimizationParams(solver)
    return gtsam.ISAM2(parameters)


def single_step_isam(spaces: Spaces, *, errors_repeat: bool, factorization: str = "CHOLESKY") -> gtsam.ISAM2:
    """An empty iSAM2 for one update per keyframe: rare relinearisation, back-substitution to millimetres.

    Where ``errors_repeat`` (correlated detection errors) it never relinearises: measurements are linear in fixed
    charts.
    """
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization(factorization)
    parameters.relinearizeSkip = NEVER if errors_repeat else STEPPED_SKIP
    thresholds = gtsam.ISAM2ThresholdMap()
    for symbol, space in (("x", spaces.robot), ("o", spaces.landmark)):
        thresholds.insert((symbol, space.far))
    for letter, size in VECTOR_SIZES.items():  # all is linear in these
        thresholds.insert((letter, np.full(size, np.inf)))
    parameters.setRelinearizeThreshold(thresholds)
    solver = gtsam.ISAM2GaussNewtonParams()
    solver.setWildfireThreshold(STIFF_WILDFIRE if errors_repeat else STEPPED_WILDFIRE)
    parameters.setOptimizationParams(solver)
    return gtsam.ISAM2(parameters)
