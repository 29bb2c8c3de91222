"""GTSAM's iSAM2 as we set it up, and who owns one."""

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.errors import ConsumedSmootherError
from semantic_slam.inference.states.keys import DESCRIPTOR, VECTOR_SIZES
from semantic_slam.inference.states.spaces import Spaces

WILDFIRE_THRESHOLD = 1e-9
"""Back-substitution goes on until changes are below this, so that estimates are those of the whole system."""
STEPPED_SKIP, STEPPED_WILDFIRE = 10, 5e-3
"""Where updates are not iterated: keyframes from one relinearisation to the next, and change below which
back-substitution stops, metres or radians."""
AT_ONCE = 2.0
"""Thresholds by which a keyframe moves the robot from where odometry has it, where errors of detections repeat, from
which on all is linearised anew at once: the next keyframes would else be weighed as if it had not come back."""
NEVER = 1 << 30
"""Updates from one relinearisation to the next where measurements are made linear in charts that stay."""
STIFF_WILDFIRE = 1e-3
"""That change where errors of detections repeat: what is left of a detection's error is a third of the whole."""


class OwnedIsam:
    """An iSAM2, which one smoother at a time reads and updates."""

    def __init__(self, isam: gtsam.ISAM2) -> None:
        self._isam: gtsam.ISAM2 | None = isam

    @property
    def isam(self) -> gtsam.ISAM2:
        """The iSAM2. Raises ConsumedSmootherError where it was handed on."""
        if self._isam is None:
            raise ConsumedSmootherError("this smoother was consumed by its update; fork() it before, to keep it")
        return self._isam

    def fork(self) -> "OwnedIsam":
        """A copy of the iSAM2, for another owner."""
        return OwnedIsam(gtsam.ISAM2(self.isam))

    def hand_on(self) -> "OwnedIsam":
        """The iSAM2 handed on to another owner; this one raises from now on."""
        other, self._isam = OwnedIsam(self.isam), None
        return other


def new_isam(spaces: Spaces, descriptor_threshold: Array, factorization: str = "CHOLESKY") -> gtsam.ISAM2:
    """An empty one that relinearises at every update; (L,) thresholds of descriptors where there are any."""
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization(factorization)
    parameters.relinearizeSkip = 1
    thresholds = gtsam.ISAM2ThresholdMap()
    for symbol, space in (("x", spaces.robot), ("o", spaces.landmark)):
        thresholds.insert((symbol, space.relinearize_threshold))
    if len(descriptor_threshold):
        thresholds.insert((DESCRIPTOR, descriptor_threshold))
    parameters.setRelinearizeThreshold(thresholds)
    solver = gtsam.ISAM2GaussNewtonParams()
    solver.setWildfireThreshold(WILDFIRE_THRESHOLD)
    parameters.setOptimizationParams(solver)
    return gtsam.ISAM2(parameters)


def single_step_isam(spaces: Spaces, *, errors_repeat: bool, factorization: str = "CHOLESKY") -> gtsam.ISAM2:
    """An empty one for one update per keyframe: relinearised seldom, back-substituted to millimetres.

    Where ``errors_repeat`` it relinearises nothing: measurements are made linear in charts that stay.
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
