"""A belief as the hypothesis manager hands it to its services."""

from pathlib import Path

from worlds.belief_factory import measurements_at, run_configuration

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.ros.services.belief_service import BeliefUpdate


def update_of(
    belief: HybridBelief,
    *,
    measurements: SemanticMeasurements | None = None,
    map_prior: MapPrior | None = None,
    kept_run: KeptRun | None = None,
) -> BeliefUpdate:
    """The update with a belief; by default of a keyframe without detections, and of another run without keyframes."""
    return BeliefUpdate(
        belief=belief,
        measurements=measurements_at(0, [], ()) if measurements is None else measurements,
        map_prior=map_prior,
        kept_run=KeptRun(run_configuration(Path("bag"), (), ("",) * 7)) if kept_run is None else kept_run,
    )
