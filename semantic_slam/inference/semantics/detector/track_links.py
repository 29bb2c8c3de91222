"""Tracks of a detector's boxes as association evidence.

A box that continues the track of an object's newest box is of that object, up to a share of errors. So a box is not of
an object whose track another box of the frame continues, and a box that starts an object does not continue an object's
track. New tracks carry no evidence.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array

NO_TRACK = ""
"""In place of a track's name, where none is given."""


@dataclass(frozen=True)
class TrackLinks:
    """Evidence of tracks, a share of which wrongly continue with another object's box."""

    error_share: float

    def log_pairs(self, tracks: Sequence[str], known: Sequence[str]) -> Array:
        """(D, M + 1) log evidence of D boxes of ``tracks`` as of M objects with newest tracks ``known``, or of none."""
        own, told = np.array([*known, NO_TRACK]), np.array(tracks, dtype=np.str_)[:, None]
        goes_on = (told == own) & (told != NO_TRACK)
        is_of_another = goes_on.any(axis=1, keepdims=True)
        has_gone_elsewhere = goes_on.any(axis=0)
        wrong = (is_of_another | has_gone_elsewhere) & ~goes_on & (told != NO_TRACK)
        log_error, log_right = np.log(self.error_share), np.log1p(-self.error_share)
        return np.where(goes_on, log_right, np.where(wrong, log_error, 0.0))
