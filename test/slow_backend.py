"""A backend node that is far slower than the bag: run as a process by the test of lossless replay."""

import time

from semantic_slam.inference.backend import Backend
from semantic_slam.inference.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates
from semantic_slam.ros.backend_node import BackendNode
from semantic_slam.ros.pipeline_node import main_of

DELAY_S = 0.3


class SlowBackend(Backend):
    """Takes its time over every keyframe."""

    def expand(self, keyframe: Keyframe) -> Candidates:
        time.sleep(DELAY_S)
        return super().expand(keyframe)


if __name__ == "__main__":
    main_of(lambda: BackendNode(SlowBackend), __doc__ or "")()
