"""Backend pool for tests in which the first backend dies before a given keyframe."""

from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates


class ForgetfulPool(InProcessPool):
    """In-process pool that loses its first backend before keyframe ``dies_at``."""

    def __init__(self, number: int, dies_at: int = 9) -> None:
        super().__init__(number)
        self._dies_at = dies_at

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """First message round, with the backends that are left."""
        if keyframe.index == self._dies_at and 0 in self.backend_ids:
            self.backend_ids = self.backend_ids[1:]
            self._backends = self._backends[1:]
        return super().expand(keyframe)
