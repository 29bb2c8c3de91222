"""What the tracks of a detector's boxes tell: of which object a detection is.

A box that goes on with the track of an object's newest one is of that object, but for a share of errors; so a box is of
another object than the one whose track another box of the frame goes on with, and what begins an object is no box of a
track that an object has. Tracks that nobody has had before tell nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array

NO_TRACK = ""
"""In place of a track's name, where none is told."""


@dataclass(frozen=True)
class TrackLinks:
    """Evidence of tracks, a share of which go on with another object's box."""

    error_share: float

    def log_pairs(self, tracks: Sequence[str], known: Sequence[str]) -> Array:
        """(D, M + 1) log evidence of D boxes of ``tracks`` as one of M objects with newest tracks, and as of none."""
        own, told = np.array([*known, NO_TRACK]), np.array(tracks, dtype=np.str_)[:, None]
        goes_on = (told == own) & (told != NO_TRACK)
        is_of_another = goes_on.any(axis=1, keepdims=True)
        has_gone_elsewhere = goes_on.any(axis=0)
        wrong = (is_of_another | has_gone_elsewhere) & ~goes_on & (told != NO_TRACK)
        log_error, log_right = np.log(self.error_share), np.log1p(-self.error_share)
        return np.where(goes_on, log_right, np.where(wrong, log_error, 0.0))
