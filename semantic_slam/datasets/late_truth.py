"""What it means for errors that the true poses of a drive begin after its odometry."""

import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.standard import NANOSECONDS

LITTLE_NS = 100_000_000
"""The truth may begin so much after odometry by chance, as each sensor has a rate of its own."""


def tell_late_truth(title: str, late_ns: int, first: Array, then: Array) -> None:
    """Print a line if the truth begins ``late_ns`` after odometry and that is more than a little.

    ``first`` and ``then`` (7,) are the poses by odometry where it begins and where the truth begins. The truth starts
    at the origin of its frame and a run's first pose is that of map, so what was driven in between lies between both.
    """
    if late_ns <= LITTLE_NS:
        return
    driven = se3.between(first, then)
    metres, degrees = np.linalg.norm(driven[:3]), np.rad2deg(np.linalg.norm(so3.log(driven[3:])))
    print(
        f"{title}: true poses begin {late_ns / NANOSECONDS:.1f} s after odometry, which had moved by {metres:.2f} m and"
        f" {degrees:.0f} degrees by then: errors that are not aligned (ate_m) are off by that; use ate_aligned_m, or"
        " give odometry from the first true pose on"
    )
