"""``python -m semantic_slam_lab.kills``: kills nodes of a demo, and compares its beliefs with an undisturbed one's.

Each trial is a demo of its own. ``--nodes``: each node is killed at every tenth keyframe, in one trial or, where it is
still down from the last time, in several.
``--all N``: everything at once, the demo, too, at random instants, N times; each time the demo goes on with --resume.
"""

import argparse
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np

from semantic_slam.bag.reader import BagReader
from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode

NODES = ("backend_0", "backend_1", "classifier", "hypothesis_manager", "bag_recorder", "bag_player")
EVERY = 10
TOLERANCE = 1e-9
LIMIT_S = 1800.0
DOMAIN_ID = os.environ.get("ROS_DOMAIN_ID", "49")
MOST_KEYFRAMES, MOST_WAIT_S = 6, 1.0
"""Between two times that everything is killed: fewer keyframes than that, and at most that long."""


@dataclass
class Demo:
    """One demo that is watched from outside."""

    bag: Path
    config: Path
    out: Path
    domain_id: str = DOMAIN_ID
    newest: int = -1  # keyframe of the newest belief
    _processes: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start(self, *options: str) -> None:
        """Start it; ``options`` besides bag, configuration and output."""
        words = [sys.executable, "-c", "from semantic_slam.ros.demo import main; main()"]
        words += ["--bag", str(self.bag), "--config", str(self.config), "--out", str(self.out), *options]
        environment = os.environ | {"ROS_DOMAIN_ID": self.domain_id}
        self.out.parent.mkdir(parents=True, exist_ok=True)
        with (self.out.parent / f"{self.out.name}.log").open("ab") as log:
            self._processes.append(subprocess.Popen(words, env=environment, stdout=log, stderr=log))

    def nodes(self) -> dict[str, int]:
        """Process ids of its nodes that run, by name."""
        children = Path(f"/proc/{self._processes[-1].pid}/task/{self._processes[-1].pid}/children")
        found = {}
        for pid in children.read_text().split():
            name = _node_name(int(pid))
            if name:
                found[name] = int(pid)
        return found

    @contextmanager
    def running(self) -> Iterator[None]:
        """A context in which it runs, and after which it does not."""
        self.start()
        try:
            yield
        finally:
            if self.is_running:
                self._processes[-1].terminate()

    @property
    def is_running(self) -> bool:
        """Whether it has not come to its end."""
        return self._processes[-1].poll() is None

    def kill(self, name: str) -> bool:
        """Kill a node, if it runs; whether it did."""
        pid = self.nodes().get(name)
        if pid is not None:
            os.kill(pid, signal.SIGKILL)
        return pid is not None

    def kill_all(self) -> None:
        """Kill everything at once."""
        pids = list(self.nodes().values())
        self._processes[-1].kill()
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        self._processes[-1].wait()

    def comes_to(self, keyframe: int) -> bool:
        """Whether it comes to a keyframe before it ends."""
        give_up = time.monotonic() + LIMIT_S
        while self.newest < keyframe and self._processes[-1].poll() is None and time.monotonic() < give_up:
            time.sleep(0.02)
        return self.newest >= keyframe

    def end(self) -> None:
        """Wait for its end. Raises SemanticSlamError when that is not good."""
        code = self._processes[-1].wait(LIMIT_S)
        if code:
            raise SemanticSlamError(f"the demo ended with exit code {code}; see {self.out}.log")

    def beliefs(self) -> list[HybridBelief]:
        """What it has recorded."""
        with BagReader(self.out / "belief") as reader:
            return [decode(message.cdr, message.type_name) for message in reader.messages([topics.BELIEF])]


def _node_name(pid: int) -> str:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return ""
    names = [word.decode().partition(":=")[2] for word in words if word.startswith(b"__node:=")]
    return names[0] if names else ""


@contextmanager
def watched(demo: Demo) -> Iterator[None]:
    """Follow the beliefs of the demo's domain."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from semantic_slam.ros import qos
    from semantic_slam.ros.transport import receive

    def note(data: bytes) -> None:
        demo.newest = max(demo.newest, decode(data, topics.TYPES[topics.BELIEF]).keyframe)

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(demo.domain_id))
    node = rclpy.create_node("kills", context=context)
    receive(node, topics.BELIEF, note, qos.everything())
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    is_over = threading.Event()

    def follow() -> None:
        while not is_over.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
        context.try_shutdown()


def largest_difference(ours: Sequence[HybridBelief], theirs: Sequence[HybridBelief], besides: str = "") -> float:
    """Over all numbers of all beliefs, those of one field apart; infinite where they are not of the same keyframes,
    hypotheses and objects.
    """
    if [belief.keyframe for belief in ours] != [belief.keyframe for belief in theirs]:
        return np.inf
    return max((_difference(a, b, besides) for a, b in zip(ours, theirs, strict=True)), default=0.0)


def _difference(ours: HybridBelief, theirs: HybridBelief, besides: str) -> float:
    largest = 0.0
    for name, value in vars(theirs).items():
        if name == besides:
            continue
        other = getattr(ours, name)
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            if value.shape != other.shape or not np.array_equal(np.isfinite(value), np.isfinite(other)):
                return np.inf
            known = np.isfinite(value)
            largest = max(largest, float(np.abs(value - other)[known].max(initial=0.0)))
        elif isinstance(value, float):
            is_same = value == other or (np.isnan(value) and np.isnan(other))
            largest = max(largest, 0.0 if is_same else float(abs(value - other)))
        elif not np.array_equal(value, other):
            return np.inf
    return largest


def run_killing(demo: Demo, kills: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """Run a demo to its end, killing each node at its keyframe; which kills found their node still down.

    Raises SemanticSlamError.
    """
    missed = []
    with watched(demo):
        demo.start()
        for keyframe, name in kills:
            if not demo.comes_to(keyframe):
                raise SemanticSlamError(f"the demo has not come to keyframe {keyframe}; see {demo.out}.log")
            if not demo.kill(name):
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
            demo.kill_all()
            seen.append(demo.newest)
            demo.start("--resume")
        demo.end()
    return seen


def command() -> None:
    parser = CommandParser("python -m semantic_slam_lab.kills", description=__doc__)
    parser.add_argument("--bag", type=Path, default=Path("bags/aliased_room"))
    parser.add_argument("--config", type=Path, default=Path("config/default.yaml"))
    parser.add_argument("--out", type=Path, default=Path("out/kills"))
    parser.add_argument("--nodes", nargs="*", default=list(NODES), help="nodes to be killed (default: each)")
    parser.add_argument("--all", type=int, default=20, help="how often everything is killed (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    report(arguments)


def report(arguments: argparse.Namespace) -> None:
    """Run all trials and print a line for each; raises SemanticSlamError when one differs."""
    undisturbed = Demo(arguments.bag, arguments.config, arguments.out / "undisturbed")
    run_killing(undisturbed, [])
    reference = undisturbed.beliefs()
    worst = 0.0
    for name in arguments.nodes:
        due = [(keyframe, name) for keyframe in range(EVERY, len(reference), EVERY)]
        for trial in count():
            if not due:
                break
            demo = Demo(arguments.bag, arguments.config, arguments.out / f"{name}_{trial}")
            missed = run_killing(demo, due)
            killed = [keyframe for keyframe, _ in due if (keyframe, name) not in missed]
            worst = max(worst, _told(f"{name} killed at keyframes {killed}", demo, reference))
            due = missed
    num_killed = 0
    for trial in range(arguments.all):
        demo = Demo(arguments.bag, arguments.config, arguments.out / f"all_{trial}")
        seen = run_killing_all(demo, arguments.all - num_killed, arguments.seed + trial)
        worst = max(worst, _told(f"everything killed {len(seen)} times, at keyframes {seen}", demo, reference))
        num_killed += len(seen)
        if num_killed == arguments.all:
            break
    if worst > TOLERANCE:
        raise SemanticSlamError(f"beliefs differ by {worst:.3g}")


def _told(what: str, demo: Demo, reference: Sequence[HybridBelief]) -> float:
    beliefs = demo.beliefs()
    difference = largest_difference(beliefs, reference)
    print(f"{what}: {len(beliefs)} of {len(reference)} beliefs, largest difference {difference:.3g}", flush=True)
    return difference


if __name__ == "__main__":
    run_main(command)
