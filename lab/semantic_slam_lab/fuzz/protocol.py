"""What a manager and one backend say in a short run, as messages."""

from collections.abc import Mapping
from typing import Any

from semantic_slam.configuration import from_dict
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.messages.codec import to_message
from semantic_slam_lab.fuzz import small_drive


class ListeningPool:
    """Backends of this process, and all that is said to them."""

    def __init__(self) -> None:
        self._pool = InProcessPool(1)
        self.backend_ids = self._pool.backend_ids
        self.said: list[Any] = []
        self._run_id = ""

    def start(self, run: RunConfiguration) -> None:
        self._run_id = run.run_id
        self.said.append(to_message(run))
        self._pool.start(run)

    def begin(self, keyframe: Keyframe) -> None:
        self._pool.begin(keyframe)

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        self.said.append(to_message(keyframe, run_id=self._run_id))
        return self._pool.expand(keyframe)

    def commit(self, commit: Commit) -> list[Components]:
        self.said.append(to_message(commit))
        return self._pool.commit(commit)

    def offer(self, components: Mapping[int, Component]) -> None:
        self._pool.offer(components)


def spoken(num_keyframes: int = 2) -> list[Any]:
    """Announcement, then keyframe and commit in turn."""
    configuration = from_dict(small_drive.PLAIN)
    run = make_run_configuration(
        configuration, small_drive.map_prior(), *initial_pose_of(configuration), stamp_ns=small_drive.START_NS
    )
    pool = ListeningPool()
    engine = Engine.of_run(run, pool)
    for k in range(num_keyframes):
        seen = [Detection.at(float(x) - 0.1 * (k + 1), float(y)) for x, y in small_drive.OBJECTS]
        engine.process(Keyframe.planar(k, detections=seen, motion=(0.1, 0.0, 0.0)))
    return pool.said
