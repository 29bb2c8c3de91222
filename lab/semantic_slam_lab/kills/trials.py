"""Demos that are disturbed: what is killed when, and what their beliefs are against those of one left in peace."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam_lab.kills.comparison import kept, largest_difference
from semantic_slam_lab.kills.demo import Demo, watched

EVERYTHING = "everything"
EVERY = 10
MOST_KEYFRAMES, MOST_WAIT_S = 6, 1.0
"""Between two times that everything is killed: fewer keyframes than that, and at most that long."""


@dataclass(frozen=True)
class Trial:
    """One demo, and what came of it."""

    killed: str  # a node, or :data:`EVERYTHING`
    at: tuple[int, ...]  # newest keyframes at the kills
    beliefs: int
    of: int  # beliefs of the demo that was left in peace
    largest_difference: float  # over all their numbers; infinite where they cannot be compared

    @property
    def kept(self) -> dict[str, Any]:
        """For result.json."""
        return asdict(self) | {"largest_difference": kept(self.largest_difference)}

    @property
    def line(self) -> str:
        """For the console."""
        told = f"{self.beliefs} of {self.of} beliefs, largest difference {self.largest_difference:.3g}"
        return f"{self.killed} killed at keyframes {list(self.at)}: {told}"


@dataclass(frozen=True)
class Grid:
    """Where demos of one bag write, how they are started, and the beliefs of the one that was left in peace."""

    bag: Path
    config: Path
    out: Path
    through_launch: bool
    reference: tuple[HybridBelief, ...]

    def one_node(self, name: str) -> Iterator[Trial]:
        """Kill a node at every tenth keyframe, in several demos where it is still down from the last time."""
        due = [(keyframe, name) for keyframe in range(EVERY, len(self.reference), EVERY)]
        for number in count():
            if not due:
                return
            demo = self._demo(f"{name}_{number}")
            missed = run_killing(demo, due)
            if missed == due:
                raise SemanticSlamError(f"{name} was never seen to run; see {demo.out}.log")
            yield self._trial(name, demo, [keyframe for keyframe, own in due if (keyframe, own) not in missed])
            due = missed

    def everything(self, times: int, seed: int) -> Iterator[Trial]:
        """Kill everything at random instants, so often in all."""
        for number in range(times):
            demo = self._demo(f"all_{number}")
            seen = run_killing_all(demo, times, seed + number)
            yield self._trial(EVERYTHING, demo, seen)
            times -= len(seen)
            if times == 0:
                return

    def _demo(self, name: str) -> Demo:
        return Demo(self.bag, self.config, self.out / name, self.through_launch)

    def _trial(self, killed: str, demo: Demo, at: Sequence[int]) -> Trial:
        beliefs = demo.beliefs()
        difference = largest_difference(beliefs, self.reference)
        return Trial(killed, tuple(at), len(beliefs), len(self.reference), difference)


def grid(bag: Path, config: Path, out: Path, *, through_launch: bool = False) -> Grid:
    """A demo that is left in peace, and where to run others. Raises SemanticSlamError."""
    undisturbed = Demo(bag, config, out / "undisturbed", through_launch)
    run_killing(undisturbed, [])
    return Grid(bag, config, out, through_launch, tuple(undisturbed.beliefs()))


def run_killing(demo: Demo, kills: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """Run a demo to its end, killing each node at its keyframe; which kills were missed.

    A node may still be down, or its keyframe be heard of too late. Raises SemanticSlamError.
    """
    missed = []
    with watched(demo):
        demo.start()
        for keyframe, name in kills:
            if not (demo.comes_to(keyframe) and demo.kill(name)):
                missed.append((keyframe, name))
        demo.end()
    return missed


def run_killing_all(demo: Demo, times: int, seed: int) -> list[int]:
    """Kill everything at random instants and go on, then run to the end; the newest keyframes seen at the kills."""
    chance = np.random.default_rng(seed)
    seen = []
    with watched(demo):
        demo.start()
        for _ in range(times):
            if not demo.comes_to(demo.newest + int(chance.integers(1, MOST_KEYFRAMES))):
                break
            time.sleep(float(chance.uniform(0.0, MOST_WAIT_S)))
            if not demo.is_running:
                break
            demo.kill_all()
            seen.append(demo.newest)
            demo.start(resumes=True)
        demo.end()
    return seen
