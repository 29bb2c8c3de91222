"""Nodes as processes of their own, without ros2launch: started, watched, and ended by their ids."""

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from semantic_slam.errors import SemanticSlamError
from semantic_slam.ros.node_set import NodeSpec

GRACE_S = 10.0
PR_SET_PDEATHSIG = 1
LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None
TAIL_LINES = 12


class NodeProcesses:
    """A context in which nodes run; at its end all of them are ended, and when this process is killed, too.

    Their output goes to ``logs/<name>.log``.
    """

    def __init__(self, logs: Path, environment: Mapping[str, str]) -> None:
        self._logs = logs
        self._environment = dict(environment)
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Self:
        self._logs.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, spec: NodeSpec, command: Sequence[str] = (), *, show_errors: bool = False) -> None:
        """Start a node; ``command`` replaces its executable, ``show_errors`` leaves its stderr on the terminal."""
        parameters = self._logs / f"{spec.name}.yaml"
        # JSON is YAML; written with the node's name so that nothing else takes these parameters.
        parameters.write_text(json.dumps({f"/{spec.name}": {"ros__parameters": _nested(spec.parameters)}}), "utf-8")
        options = ["-r", f"__node:={spec.name}", "--params-file", str(parameters)]
        words = [*(command or [spec.executable]), "--ros-args", *options]
        with self._log(spec.name).open("wb") as log:
            self._processes[spec.name] = subprocess.Popen(
                words,
                stdout=log,
                stderr=None if show_errors else subprocess.STDOUT,
                env=self._environment,
                preexec_fn=partial(_end_with, os.getpid()),
            )

    def exit_code(self, name: str) -> int | None:
        """How a node ended; None while it runs."""
        return self._processes[name].poll()

    def kill(self, name: str) -> None:
        """End a node at once, as a crash would."""
        self._processes[name].kill()
        self._processes[name].wait()

    def wait(self, name: str, timeout_s: float) -> None:
        """Wait until the node has ended well. Raises SemanticSlamError, with its last lines, when any node dies."""
        give_up = time.monotonic() + timeout_s
        while self.exit_code(name) is None:
            self.check()
            if time.monotonic() > give_up:
                raise SemanticSlamError(f"{name} has not ended after {timeout_s:.0f} s\n{self._all_tails()}")
            time.sleep(0.05)
        self.check()

    def check(self) -> None:
        """Raises SemanticSlamError with the last lines of a node that died."""
        for name, process in self._processes.items():
            if process.poll():
                raise SemanticSlamError(f"{name} ended with exit code {process.returncode}:\n{self.tail(name)}")

    def tail(self, name: str) -> str:
        """The last lines of a node's output."""
        lines = self._log(name).read_text("utf-8", errors="replace").splitlines()
        return "\n".join(f"  {line}" for line in lines[-TAIL_LINES:])

    def stop(self) -> None:
        """Interrupt what still runs, and kill what does not end by itself."""
        running = [process for process in self._processes.values() if process.poll() is None]
        for process in running:
            process.send_signal(signal.SIGINT)
        give_up = time.monotonic() + GRACE_S
        for process in running:
            try:
                process.wait(max(0.0, give_up - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"

    def _all_tails(self) -> str:
        return "\n".join(f"{name}:\n{self.tail(name)}" for name in self._processes)


def loopback_environment(domain_id: int) -> dict[str, str]:
    """Environment of this process with ROS traffic on this machine only, in a domain of its own."""
    return os.environ | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(domain_id),
        "PYTHONUNBUFFERED": "1",
        "OMP_NUM_THREADS": "1",
    }


def _end_with(parent: int) -> None:
    """Called in a new process before its program begins: the kernel ends it when its parent has died, however."""
    if LIBC is None:
        return
    LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it has died meanwhile
        os._exit(1)


def _nested(parameters: Mapping[str, object]) -> dict[str, object]:
    """``a.b`` keys as nested mappings."""
    nested: dict[str, object] = {}
    for name, value in parameters.items():
        *path, last = name.split(".")
        level = nested
        for key in path:
            level = level.setdefault(key, {})  # type: ignore[assignment]
        level[last] = value
    return nested
