"""Backends that outlive the engine that they worked for."""

from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration


class LivingPool(InProcessPool):
    """The backends of another engine, which go on."""

    def __init__(self, pool: InProcessPool) -> None:
        self.backend_ids, self._backends = pool.backend_ids, pool._backends

    def start(self, run: RunConfiguration) -> None:
        """They know the run."""
