"""Base of the hypothesis manager's services that answer from the newest belief."""

from dataclasses import dataclass

from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.journal.kept_run import KeptRun


@dataclass(frozen=True, kw_only=True)
class BeliefUpdate:
    """A belief, and what it was inferred from."""

    belief: HybridBelief
    measurements: SemanticMeasurements  # of the belief's keyframe
    map_prior: MapPrior | None  # of the run
    kept_run: KeptRun  # configuration and keyframes of the run up to this belief or beyond


class BeliefService:
    """Keeps the newest belief of the current run; one thread may update it while another answers."""

    def __init__(self) -> None:
        self._update: BeliefUpdate | None = None

    def begin(self) -> None:
        """Start another run: forget the belief."""
        self._update = None

    def update(self, update: BeliefUpdate) -> None:
        """Set the newest belief."""
        self._update = update

    def newest(self) -> BeliefUpdate:
        """The newest update. Raises InputError before the first one of a run."""
        update = self._update
        if update is None:
            raise InputError("there is no belief yet; ask after the first keyframe")
        return update
