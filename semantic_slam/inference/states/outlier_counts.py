"""Expected number of geometric outliers in a hypothesis, from which the outlier probability is learned."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class OutlierCounts:
    """Number of detections of known static objects, and the expected number of outliers among them."""

    detections: float = 0.0
    outliers: float = 0.0

    def with_more(self, probabilities: Array) -> "OutlierCounts":
        """Add n detections, with their (n,) outlier probabilities."""
        return OutlierCounts(self.detections + len(probabilities), self.outliers + float(probabilities.sum()))

    def share(self, known: float, counts: float) -> float:
        """Posterior mean of the outlier share, given a beta prior of mean ``known`` worth ``counts`` detections."""
        return (known * counts + self.outliers) / (counts + self.detections)
