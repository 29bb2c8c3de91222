"""A detector's labels ("words") for its detections, its scores for the other labels, and apparent box sizes."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array, Index

NO_WORD = -1
"""In place of a label, where the detector gives none."""


@dataclass(frozen=True, kw_only=True)
class DetectorWords:
    """Labels of D detections out of W words: the detector's labels, and last "any other"."""

    answers: Index  # (D,) label of each detection; NO_WORD where it has none
    shares: Array  # (D, W) scores, which sum to 1; uniform where the detector gives none
    log_angles: Array | None = None  # (D,) log of apparent box size (size / range); NaN: unknown
