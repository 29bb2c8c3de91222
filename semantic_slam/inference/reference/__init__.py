"""The null (reference) model of a run, against which the belief's fit to the data is measured."""

from semantic_slam.inference.reference.reference import Reference
from semantic_slam.inference.reference.scores import NO_SCORES, EvenWords, KeyframeScores, ScoreDensity

__all__ = ["NO_SCORES", "EvenWords", "KeyframeScores", "Reference", "ScoreDensity"]
