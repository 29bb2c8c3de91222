"""Hypothesis manager with its backends in this process, for the offline pipeline."""

from collections import Counter

from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import Configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import BackendPool
from semantic_slam.inference.relocation.carried_spans import Spans
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.pipeline.preamble import Preamble
from semantic_slam.pipeline.recorded_views import RecordedViews
from semantic_slam.pipeline.start import announced_run


class InferenceStage:
    """Hypothesis manager that starts with the first keyframe, whose stamp becomes the run's stamp."""

    def __init__(
        self, configuration: Configuration, prior: MapPrior | None, preamble: Preamble, source: str, pool: BackendPool
    ) -> None:
        self._configuration, self._prior, self._source = configuration, prior, source
        self._estimate, self._pool = preamble.initial_pose, pool
        self._labels = preamble.labels
        self._manager: Engine | None = None
        self._views = RecordedViews()

    @property
    def lost(self) -> Counter[str]:
        """Counts of hypotheses that had to be dropped, by reason."""
        return self._manager.lost if self._manager is not None else Counter()

    @property
    def carried(self) -> Spans:
        """Keyframes in which the robot was taken for carried elsewhere."""
        return self._manager.carried_spans.spans if self._manager is not None else ()

    def process(self, keyframe: Keyframe, writer: BagWriter) -> None:
        """Process a keyframe and write its belief, preceded by the run's configuration before the first one."""
        if self._manager is None:
            self._manager = self._start(keyframe, writer)
        belief = self._manager.process(keyframe)
        writer.write(topics.BELIEF, belief, keyframe.stamp_ns)
        self._views.add(belief, writer)

    def finish(self, writer: BagWriter) -> None:
        """Write the whole path and the markers of the last belief."""
        self._views.finish(writer)

    def _start(self, first: Keyframe, writer: BagWriter) -> Engine:
        run = announced_run(
            self._configuration, self._prior, self._estimate, first, labels=self._labels, source=self._source
        )
        writer.write(topics.RUN_CONFIGURATION, run, first.stamp_ns)
        return Engine.of_run(run, self._pool)
