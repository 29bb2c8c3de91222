"""Runs nodes as processes without ros2launch: starts, monitors and ends them by process id."""

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
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.launching.supervisor import Supervisor

GRACE_S = 10.0
PR_SET_PDEATHSIG = 1
LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None
TAIL_LINES = 12


class NodeProcesses:
    """Context manager for node processes; they end with the context, or when this process is killed.

    Their output goes to ``logs/<name>.log``. With a ``supervisor`` nodes that die are restarted during :meth:`wait` and
    :meth:`check`; without one a nonzero exit code raises SemanticSlamError there.
    """

    def __init__(self, logs: Path, environment: Mapping[str, str], supervisor: Supervisor | None = None) -> None:
        self._logs = logs
        self._environment = dict(environment)
        self._supervisor = supervisor
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._commands: dict[str, tuple[Sequence[str], bool]] = {}
        self._settled: set[int] = set()  # ids of ended processes that have been handled
        self._due: dict[str, tuple[float, NodeSpec]] = {}  # by name: when to restart which node

    def __enter__(self) -> Self:
        self._logs.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, spec: NodeSpec, command: Sequence[str] = (), *, show_errors: bool = False) -> None:
        """Start a node's process; ``command`` replaces its executable, ``show_errors`` shows stderr on the terminal."""
        self._commands[spec.name] = (command, show_errors)
        parameters = self._logs / f"{spec.name}.yaml"
        # JSON is valid YAML; the key with the node's name keeps other nodes from taking these parameters.
        given = {f"/**/{spec.name}": {"ros__parameters": _nested(spec.parameters)}}
        parameters.write_text(json.dumps(given), "utf-8")
        options = ["-r", f"__node:={spec.name}", "--params-file", str(parameters)]
        words = [*(command or [spec.executable]), "--ros-args", *options]
        mode = "ab" if spec.name in self._processes else "wb"
        with self._log(spec.name).open(mode) as log:
            self._processes[spec.name] = subprocess.Popen(
                words,
                stdout=log,
                stderr=None if show_errors else subprocess.STDOUT,
                env=self._environment,
                preexec_fn=partial(end_with, os.getpid()),
            )

    def exit_code(self, name: str) -> int | None:
        """Exit code of a node, -signal if it was killed by one; None while it runs."""
        return self._processes[name].poll()

    def pids(self) -> dict[str, int]:
        """Process ids of the running nodes, by name."""
        return {name: process.pid for name, process in self._processes.items() if process.poll() is None}

    def kill(self, name: str) -> None:
        """Kill a node with SIGKILL, to simulate a crash."""
        self._processes[name].kill()
        self._processes[name].wait()

    def wait(self, name: str, timeout_s: float) -> None:
        """Wait until a node has exited with code 0. Raises SemanticSlamError on timeout and as :meth:`check` does."""
        give_up = time.monotonic() + timeout_s
        while self.exit_code(name) != 0:
            self.check()
            if time.monotonic() > give_up:
                raise SemanticSlamError(f"{name} has not ended after {timeout_s:.0f} s\n{self._all_tails()}")
            time.sleep(0.05)
        self.check()

    def check(self) -> None:
        """Handle ended nodes and due restarts. Raises SemanticSlamError, with its last lines, if one ends the run."""
        now_s = time.monotonic()
        for name, process in list(self._processes.items()):
            code = process.poll()
            if code is not None and process.pid not in self._settled:
                self._settle(name, code, now_s)
                self._settled.add(process.pid)
        for name, (at_s, spec) in list(self._due.items()):
            if now_s >= at_s:
                del self._due[name]
                command, show_errors = self._commands[name]
                self.start(spec, command, show_errors=show_errors)

    def _settle(self, name: str, code: int, now_s: float) -> None:
        if self._supervisor is None:
            if code:
                raise SemanticSlamError(f"{name} ended with exit code {code}:\n{self.tail(name)}")
            return
        verdict = self._supervisor.ended(name, code, now_s)
        if code and verdict.ends_run:
            raise SemanticSlamError(f"{verdict.text}:\n{self.tail(name)}")
        if code and verdict.text:
            print(verdict.text, file=sys.stderr)
        for other in verdict.kill:
            if self._processes[other].pid in self._settled:
                self._supervisor.is_down(other)
            else:
                self._processes[other].kill()
        if verdict.again is not None:
            self._due[name] = (now_s + verdict.after_s, verdict.again)

    def tail(self, name: str) -> str:
        """The last lines of a node's log."""
        lines = self._log(name).read_text("utf-8", errors="replace").splitlines()
        return "\n".join(f"  {line}" for line in lines[-TAIL_LINES:])

    def stop(self) -> None:
        """Send SIGINT to all running nodes, and SIGKILL to those that do not end within ``GRACE_S``."""
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
    """This process's environment, with ROS traffic limited to this machine and to the given ROS domain."""
    return os.environ | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(domain_id),
        "PYTHONUNBUFFERED": "1",
        "OMP_NUM_THREADS": "1",
    }


def end_with(parent: int) -> None:
    """Have the kernel end this process when its parent dies in any way; to be called first in a new process."""
    if LIBC is None:
        return
    LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # the parent has already died
        os._exit(1)


def _nested(parameters: Mapping[str, object]) -> dict[str, object]:
    """Nested mappings from dotted keys such as ``a.b``."""
    nested: dict[str, object] = {}
    for name, value in parameters.items():
        *path, last = name.split(".")
        level = nested
        for key in path:
            level = level.setdefault(key, {})  # type: ignore[assignment]
        level[last] = value
    return nested
