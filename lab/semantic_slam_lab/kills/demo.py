"""A demo, or the launch file, that is watched from outside, and whose nodes can be killed."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode

LIMIT_S = 1800.0
DOMAIN_ID = os.environ.get("ROS_DOMAIN_ID", "49")


@dataclass
class Demo:
    """One demo that is watched from outside."""

    bag: Path
    config: Path
    out: Path
    through_launch: bool = False  # started with ros2 launch
    domain_id: str = DOMAIN_ID
    newest: int = -1  # keyframe of the newest belief
    _processes: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start(self, *, resumes: bool = False) -> None:
        """Start it; ``resumes``: it goes on where it was killed."""
        words = self._launch(resumes=resumes) if self.through_launch else self._demo(resumes=resumes)
        environment = os.environ | {"ROS_DOMAIN_ID": self.domain_id}
        self.out.parent.mkdir(parents=True, exist_ok=True)
        with (self.out.parent / f"{self.out.name}.log").open("ab") as log:
            self._processes.append(subprocess.Popen(words, env=environment, stdout=log, stderr=log))

    def _demo(self, *, resumes: bool) -> list[str]:
        words = [sys.executable, "-c", "from semantic_slam.ros.demo import main; main()"]
        words += ["--bag", str(self.bag), "--config", str(self.config), "--out", str(self.out)]
        return [*words, "--resume"] if resumes else words

    def _launch(self, *, resumes: bool) -> list[str]:
        given = {
            "bag": self.bag,
            "config": self.config,
            "record": self.out / "belief",
            "journal": self.out / "journal",
            "resume": str(resumes).lower(),
        }
        return ["ros2", "launch", "semantic_slam", "demo.launch.py", *(f"{name}:={own}" for name, own in given.items())]

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

    from semantic_slam.ros.wire import qos
    from semantic_slam.ros.wire.transport import receive

    def note(data: bytes) -> None:
        demo.newest = max(demo.newest, decode(data, topics.TYPES[topics.BELIEF]).keyframe)

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(demo.domain_id))
    node = rclpy.create_node("kills", context=context)
    receive(node, topics.BELIEF, note, qos.everything_from_the_start())
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
