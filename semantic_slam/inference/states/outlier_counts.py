"""How many outliers in their place a hypothesis has had."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class OutlierCounts:
    """Detections of known objects that stand, and how many of them are expected to have been outliers."""

    detections: float = 0.0
    outliers: float = 0.0

    def with_more(self, probabilities: Array) -> "OutlierCounts":
        """With (n,) detections more, each an outlier with its probability."""
        return OutlierCounts(self.detections + len(probabilities), self.outliers + float(probabilities.sum()))

    def share(self, known: float, counts: float) -> float:
        """Expected share of outliers, if the share ``known`` before counts as so many detections."""
        return (known * counts + self.outliers) / (counts + self.detections)
