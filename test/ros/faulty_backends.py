"""Backend nodes that are slow, or die, as processes: ``faulty_backends.py {slow,dying} --ros-args ...``."""

import os
import signal
import sys
import time

from semantic_slam.inference.backend import Backend
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates
from semantic_slam.ros.backend_node import BackendNode
from semantic_slam.ros.node.pipeline_node import main_of

DELAY_S = 0.3
LAST_KEYFRAME = 4


class SlowBackend(Backend):
    """Far slower than the bag."""

    def expand(self, keyframe: Keyframe) -> Candidates:
        time.sleep(DELAY_S)
        return super().expand(keyframe)


class DyingBackend(Backend):
    """Killed when it is asked for the keyframe after ``LAST_KEYFRAME``."""

    def expand(self, keyframe: Keyframe) -> Candidates:
        if keyframe.index > LAST_KEYFRAME:
            print(f"killed at {time.time()}", flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
        return super().expand(keyframe)


if __name__ == "__main__":
    faulty = {"slow": SlowBackend, "dying": DyingBackend}[sys.argv.pop(1)]
    main_of(lambda: BackendNode(faulty), __doc__ or "")()
