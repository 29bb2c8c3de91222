"""Geometry alone: ours against GTSAM's HybridSmoother and DCSAM, time and association accuracy side by side.

The sensor is as accurate as the default configuration says, so that the truth can be told. A run of a peer that
takes too long or too much memory is ended in its process and counts as wrong.
"""

import multiprocessing
import resource
import signal
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection

import numpy as np
from tqdm import tqdm

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.grid.run import Setting, keyframes_of, run_of
from semantic_slam_lab.grid.world import Noise, World, grid_world
from semantic_slam_lab.peers.hybrid_peers import DcsamPeer, HybridPeer, SmootherPeer

SEEDS, QUICK_SEEDS = 20, 4
STEPS = 12
LIMIT_S = 4.0
"""Longest run of a peer."""
OUT_OF_TIME = "out of time"
MEMORY_LIMIT = 4 * 2**30
PEERS: dict[str, Callable[[World], HybridPeer]] = {"hybrid_smoother": SmootherPeer, "dcsam": DcsamPeer}


@dataclass
class Record:
    """What a method did in all runs."""

    correct: list[bool] = field(default_factory=list)  # every association of the run
    share: list[float] = field(default_factory=list)  # of the detections that are right
    seconds: list[list[float]] = field(default_factory=list)  # per step, of the runs that ended
    unfinished: list[str] = field(default_factory=list)  # why, of the runs that did not end

    def add(self, world: World, associations: list[tuple[int, ...]], seconds: list[float]) -> None:
        """Record a run that ended."""
        truth = [frame.objects for frame in world.frames]
        same = [a == b for one, other in zip(associations, truth, strict=True) for a, b in zip(one, other, strict=True)]
        self.correct.append(all(same))
        self.share.append(float(np.mean(same)))
        self.seconds.append(seconds)

    def add_failure(self, reason: str) -> None:
        """Record a run that did not end."""
        self.correct.append(False)
        self.share.append(0.0)
        self.unfinished.append(reason)

    def seconds_per_step(self) -> float:
        """Mean seconds per step over the runs that ended."""
        return float(np.mean(self.seconds)) if self.seconds else float("nan")

    def least_seconds_per_step(self) -> float:
        """Least mean seconds per step over all runs of known time: one out of time counts with its limit."""
        runs = [float(np.mean(run)) for run in self.seconds]
        runs += [LIMIT_S / STEPS for reason in self.unfinished if reason == OUT_OF_TIME]
        return float(np.mean(runs)) if runs else float("nan")

    def __str__(self) -> str:
        times = 1e3 * np.array(self.seconds or [[np.nan]])
        reasons = ", ".join(f"{count} {reason}" for reason, count in Counter(self.unfinished).items()) or "none"
        return (
            f"{np.mean(self.correct):.0%} of the runs right, {np.mean(self.share):.1%} of the detections,"
            f" unfinished: {reasons}, ms per step {times.mean():.3g} mean, {np.median(times):.3g} median,"
            f" {times.max():.3g} largest"
        )


def hybrid(quick: bool, seed: int) -> list[Row]:
    """One and two detections per step; the row without a number is that of two."""
    count = QUICK_SEEDS if quick else SEEDS
    rows = {n: _compared(n, range(seed * SEEDS, seed * SEEDS + count)) for n in (1, 2)}
    plain = rows[2][0]
    named = Row("hybrid_smoother_time", plain.ours, plain.peer, plain.unit, plain.ratio, plain.n, plain.how)
    return [named, *rows[1], *rows[2]]


def _compared(num_detections: int, seeds: range) -> list[Row]:
    ours, peers = Record(), {name: Record() for name in PEERS}
    for seed in tqdm(seeds, desc="hybrid smoothers", leave=False):
        world = sharp_world(seed, num_detections)
        ours.add(world, *run_ours(world))
        for name, record in peers.items():
            found = run_peer(name, world)
            record.add_failure(found) if isinstance(found, str) else record.add(world, *found)
    rows = [_row(f"{name}_time_n{num_detections}", ours, record) for name, record in peers.items()]
    return [*rows, *(_row_of_all(f"{name}_all_runs_n{num_detections}", ours, one) for name, one in peers.items())]


def _row(name: str, ours: Record, peer: Record) -> Row:
    mine, theirs = ours.seconds_per_step() * 1e3, peer.seconds_per_step() * 1e3
    how = (
        f"geometry alone, 6 objects, robot lost by 10 m, {STEPS} steps; means per step of the runs that ended within"
        f" {LIMIT_S:.0f} s; ours: {ours}; peer: {peer}; the peer takes landmarks as known and knows no visibility"
    )
    return Row(name, mine, theirs, "ms", mine / theirs, len(ours.correct), how)


def _row_of_all(name: str, ours: Record, peer: Record) -> Row:
    mine, theirs = ours.least_seconds_per_step() * 1e3, peer.least_seconds_per_step() * 1e3
    how = (
        f"the same worlds; means per step of all runs, those of the peer that are out of time counted with the"
        f" {LIMIT_S:.0f} s of CPU time that they had ({Counter(peer.unfinished)[OUT_OF_TIME]} of {len(peer.correct)}):"
        " less than they need"
    )
    return Row(name, mine, theirs, "ms", mine / theirs, len(ours.correct), how)


def sharp_world(seed: int, num_detections: int) -> World:
    """A world seen with the default configuration's range and bearing noise."""
    default = PerceptionConfiguration()
    noise = Noise(geometry=(default.sigma_range_m**2, default.sigma_bearing_rad**2))
    return grid_world(seed, num_detections=num_detections, num_keyframes=STEPS, noise=noise)


def run_ours(world: World) -> tuple[list[tuple[int, ...]], list[float]]:
    """Associations of the best hypothesis at the end, and seconds per step."""
    manager = Engine.of_run(run_of(world, Setting(semantics=False)), InProcessPool(1))
    seconds = []
    for keyframe in keyframes_of(world):
        start = time.thread_time()
        manager.process(keyframe)
        seconds.append(time.thread_time() - start)
    best = max(manager.live.values(), key=lambda live: live.log_weight)
    return [step.association for step in best.lineage], seconds


def run_peer(name: str, world: World) -> tuple[list[tuple[int, ...]], list[float]] | str:
    """Associations and times of a peer, run in a process of its own; the reason where it does not end."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])  # once, so that a process starts at once
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(name, world, sender), daemon=True)
    process.start()
    sender.close()
    try:
        found: tuple[list[tuple[int, ...]], list[float]] | str = receiver.recv()
    except EOFError:
        found = "killed"
    process.join()
    receiver.close()
    return OUT_OF_TIME if process.exitcode == -signal.SIGXCPU else found


def _serve(name: str, world: World, sender: Connection) -> None:
    spent = time.process_time()
    limit = int(np.ceil(spent + LIMIT_S))
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    peer, seconds = PEERS[name](world), []
    try:
        for frame in world.frames:
            start = time.thread_time()
            peer.update(frame)
            seconds.append(time.thread_time() - start)
        associations = peer.associations()
    except (RuntimeError, IndexError, ValueError, MemoryError) as fault:
        sender.send(type(fault).__name__)
        return
    sender.send((associations, seconds))
