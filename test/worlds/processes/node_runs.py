"""Replays through real nodes, each its own process over DDS, for the tests."""

import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from semantic_slam.bag.reader import BagReader
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.ros.launching.node_set import NodeSpec, RunOptions, node_set
from semantic_slam.ros.launching.processes import NodeProcesses, loopback_environment
from semantic_slam.ros.launching.supervisor import Supervisor

TIMEOUT_S = 240.0
"""Generous: on a loaded machine the processes take long to start."""
LAST_WORDS_S = 120.0
"""So long, after the end of a replay, a companion may take to print what it was sent."""


@dataclass(frozen=True)
class Replay:
    """One replay: its bag, its configuration, and what differs from the usual nodes, by node name."""

    bag: Path
    configuration: Path
    out: Path
    backends: int
    commands: Mapping[str, Sequence[str]] = field(default_factory=dict)  # instead of the executables
    parameters: Mapping[str, Mapping[str, object]] = field(default_factory=dict)  # over those of the node set
    companions: tuple[str, ...] = ()  # nodes besides those of the node set, with their commands in ``commands``

    @property
    def belief_bag(self) -> Path:
        return self.out / "belief"

    def specs(self) -> list[NodeSpec]:
        options = RunOptions(backends=self.backends, record=str(self.belief_bag))
        usual = node_set(self.bag, self.configuration, 0.0, options, has_tf2=False, has_stereo=True)
        specs = [replace(spec, parameters={**spec.parameters, **self.parameters.get(spec.name, {})}) for spec in usual]
        return [*(NodeSpec(name, name) for name in self.companions), *specs]

    def output_of(self, name: str) -> str:
        return (self.out / "log" / f"{name}.log").read_text()


def processes(folder: Path, supervisor: Supervisor | None = None) -> NodeProcesses:
    """Nodes in the domain of this test run; their output lies in ``folder``/log."""
    if shutil.which("backend_node") is None:
        raise RuntimeError("the nodes are not on PATH; run `make test`, or `source env.sh` before pytest")
    return NodeProcesses(folder / "log", loopback_environment(int(os.environ["ROS_DOMAIN_ID"])), supervisor)


def run(replay: Replay, said_all: Callable[[], bool] = lambda: True) -> list[HybridBelief]:
    """Replay losslessly and return what was recorded; companions are ended once they have ``said_all``."""
    with processes(replay.out) as nodes:
        for spec in replay.specs():
            nodes.start(spec, replay.commands.get(spec.name, ()))
        nodes.wait("bag_recorder", TIMEOUT_S)
        nodes.wait("bag_player", TIMEOUT_S)
        give_up = time.monotonic() + LAST_WORDS_S
        while not said_all() and time.monotonic() < give_up:
            time.sleep(0.05)
    return beliefs(replay.belief_bag)


def beliefs(bag: Path) -> list[HybridBelief]:
    """All beliefs of a belief bag, in the order of their log time."""
    with BagReader(bag) as reader:
        return [decode(message.cdr, message.type_name) for message in reader.messages([topics.BELIEF])]


def assert_same(live: list[HybridBelief], reference: list[HybridBelief]) -> None:
    """Equal at every keyframe, hypothesis by hypothesis: weights within 1e-9, poses within 1e-6."""
    assert [belief.stamp_ns for belief in live] == [belief.stamp_ns for belief in reference]
    for ours, theirs in zip(live, reference, strict=True):
        order, expected = np.argsort(ours.hypothesis_ids), np.argsort(theirs.hypothesis_ids)
        np.testing.assert_array_equal(ours.hypothesis_ids[order], theirs.hypothesis_ids[expected])
        np.testing.assert_array_equal(ours.associations[order], theirs.associations[expected])
        weights = np.exp(ours.log_weights[order])
        np.testing.assert_allclose(weights, np.exp(theirs.log_weights[expected]), rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(ours.poses[order], theirs.poses[expected], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(ours.object_poses, theirs.object_poses, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(ours.class_probabilities, theirs.class_probabilities, rtol=0.0, atol=1e-9)
