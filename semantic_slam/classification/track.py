"""View history of P tracks, and the covariances of a next view with it."""

from dataclasses import dataclass

from semantic_slam.classification.growing import GrowingArray
from semantic_slam.classification.processes import ClassProcesses, Marginals
from semantic_slam.geometry.arrays import Array, Index


@dataclass(frozen=True)
class NextView:
    """Predicted moments of the scores at a new view, before it is measured (Eqs. 3.15-3.16)."""

    marginals: Marginals
    covariances: Array  # (P, C, F, k) with the k earlier views

    @property
    def mean(self) -> Array:
        """(P, C, F) mean scores at the new view."""
        return self.marginals.mean

    @property
    def variance(self) -> Array:
        """(P, C, F) variances of the scores at the new view."""
        return self.marginals.variance


class TrackViews:
    """Inputs of the processes at the views of P tracks."""

    def __init__(self, processes: ClassProcesses, num_tracks: int) -> None:
        self.processes = processes
        self.batch = (num_tracks, processes.num_classes, processes.num_components)
        self._scaled = GrowingArray(self.batch, (processes.num_inputs,))
        self._whitened = GrowingArray(self.batch, (processes.rank,))

    def __len__(self) -> int:
        return len(self._scaled)

    def next(self, locations_m: Array) -> NextView:
        """Moments of a view from (P, 2) locations, and its covariances with the earlier views."""
        marginals = self.processes.marginals(locations_m)
        return NextView(marginals, self.processes.covariances(self._scaled.values, self._whitened.values, marginals))

    def append(self, view: NextView) -> None:
        """Append the view to the history."""
        self._scaled.append(view.marginals.scaled)
        self._whitened.append(view.marginals.whitened)

    def drop_first(self) -> None:
        """Drop the oldest view."""
        self._scaled.drop_first()
        self._whitened.drop_first()

    def replace(self, rows: Index, other: "TrackViews", source: Index) -> None:
        """Replace the tracks at ``rows`` by tracks ``source`` of ``other``, which has as many views."""
        self._scaled.values[rows] = other._scaled.values[source]
        self._whitened.values[rows] = other._whitened.values[source]
