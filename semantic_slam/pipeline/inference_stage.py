"""The hypothesis manager of a run in this process, with its backends."""

from collections import Counter

from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import Configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import BackendPool
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.pipeline.preamble import Preamble
from semantic_slam.pipeline.start import announced_run


class InferenceStage:
    """The hypothesis manager, started by the first keyframe, whose stamp is the run's."""

    def __init__(
        self, configuration: Configuration, prior: MapPrior | None, preamble: Preamble, source: str, pool: BackendPool
    ) -> None:
        self._configuration, self._prior, self._source = configuration, prior, source
        self._estimate, self._pool = preamble.initial_pose, pool
        self._labels = preamble.labels
        self._manager: Engine | None = None

    @property
    def lost(self) -> Counter[str]:
        """Hypotheses that had to be given up, by reason."""
        return self._manager.lost if self._manager is not None else Counter()

    def process(self, keyframe: Keyframe, writer: BagWriter) -> None:
        """One keyframe; writes the belief, and before the first one the run's configuration."""
        if self._manager is None:
            self._manager = self._start(keyframe, writer)
        writer.write(topics.BELIEF, self._manager.process(keyframe), keyframe.stamp_ns)

    def _start(self, first: Keyframe, writer: BagWriter) -> Engine:
        run = announced_run(
            self._configuration, self._prior, self._estimate, first, labels=self._labels, source=self._source
        )
        writer.write(topics.RUN_CONFIGURATION, run, first.stamp_ns)
        return Engine.of_run(run, self._pool)
