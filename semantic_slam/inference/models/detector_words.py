"""What a detector says of its detections: the word that it calls each by, its scores for others, how large it looks."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array, Index

NO_WORD = -1
"""In place of a word, where a detector tells none."""


@dataclass(frozen=True, kw_only=True)
class DetectorWords:
    """Words of D detections; W words: the labels, and last any other one."""

    answers: Index  # (D,) the word that each is called by, NO_WORD where it is called nothing
    shares: Array  # (D, W) scores of all words, which sum to 1; even where nothing is told
    log_angles: Array | None = None  # (D,) logarithms of how large their boxes look, a size per range; NaN: not told
