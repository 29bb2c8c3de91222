"""What killed processes leave of the middleware in shared memory, and that it keeps no node from starting."""

import fcntl
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from semantic_slam.ros.wire.shared_memory import FOLDER, LOCK, MADE, SETTLED_S, remove_remains

NODE = "from semantic_slam.cli.nodes import backend_node; backend_node()"
MAKER = f"""
import pathlib, sys, time
port = pathlib.Path(sys.argv[1])
port.touch()
print(flush=True)
time.sleep(0.5)
port.write_bytes({MADE + bytes(60)!r})
"""
ARGUMENTS = ("--ros-args", "-r", "__node:=backend_0")


def left(path: Path, content: bytes = b"") -> Path:
    """A file that was there long before."""
    path.write_bytes(content)
    os.utime(path, (time.time() - 2.0 * SETTLED_S,) * 2)
    return path


def test_ports_that_were_left_half_made_go_and_others_stay(tmp_path: Path) -> None:
    empty, begun = left(tmp_path / "fastrtps_port7411"), left(tmp_path / "fastrtps_port7413", bytes(64))
    made, other = left(tmp_path / "fastrtps_port7415", MADE + bytes(60)), left(tmp_path / "somebody_else")
    remove_remains(tmp_path)
    assert not empty.exists() and not begun.exists()
    assert made.exists() and other.exists()


def test_a_port_that_is_made_meanwhile_stays(tmp_path: Path) -> None:
    port = tmp_path / "fastrtps_port7411"
    maker = subprocess.Popen([sys.executable, "-c", MAKER, str(port)], stdout=subprocess.PIPE)
    assert maker.stdout is not None
    maker.stdout.readline()
    remove_remains(tmp_path)
    maker.wait()
    assert port.read_bytes()[: len(MADE)] == MADE


def test_segments_go_whose_process_has_died(tmp_path: Path) -> None:
    dead, alive = "fastrtps_0123456789abcdef", "fastrtps_fedcba9876543210"
    for name in (dead, alive):
        left(tmp_path / name, bytes(64)), left(tmp_path / f"{name}_el")
    with (tmp_path / f"{alive}_el").open("rb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        remove_remains(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [alive, f"{alive}_el"]


def start_node(said: Path, **environment: str) -> "subprocess.Popen[bytes]":
    environment = os.environ | {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"} | environment
    with said.open("wb") as output:
        return subprocess.Popen([sys.executable, "-c", NODE, *ARGUMENTS], stdout=output, stderr=output, env=environment)


def wait_until_ready(said: Path) -> None:
    give_up = time.monotonic() + 240.0
    while ": ready" not in said.read_text() and time.monotonic() < give_up:
        time.sleep(0.05)
    assert ": ready" in said.read_text()


def segments_of(pid: int) -> list[Path]:
    """Locks of the segments that a process has."""
    opened = [Path(f"/proc/{pid}/fd/{number}").readlink() for number in os.listdir(f"/proc/{pid}/fd")]
    return [path for path in opened if path.parent == FOLDER and LOCK.fullmatch(path.name)]


@pytest.mark.ros
@pytest.mark.slow
def test_a_node_starts_where_another_was_killed_while_it_made_its_port(tmp_path: Path) -> None:
    """Without that, it waits for ever: these are the ports of the first ten nodes of a domain."""
    domain = 215 + int(os.environ["ROS_DOMAIN_ID"]) % 15  # in which nobody else is
    for number in range(10):
        left(FOLDER / f"fastrtps_port{7400 + 250 * domain + 11 + 2 * number}")
    node = start_node(tmp_path / "said", ROS_DOMAIN_ID=str(domain))
    try:
        wait_until_ready(tmp_path / "said")
    finally:
        node.kill()
        node.wait()


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_a_node_that_ends_leaves_nothing_and_one_that_is_killed_nothing_for_long(tmp_path: Path) -> None:
    node = start_node(tmp_path / "first")
    wait_until_ready(tmp_path / "first")
    own = segments_of(node.pid)
    node.terminate()
    node.wait()
    assert own and not any(map(Path.exists, own))
    node = start_node(tmp_path / "second")
    wait_until_ready(tmp_path / "second")
    own = segments_of(node.pid)
    remove_remains()
    assert own and all(map(Path.exists, own))
    node.kill()
    node.wait()
    for lock in own:
        os.utime(lock, (time.time() - 2.0 * SETTLED_S,) * 2)
    remove_remains()
    assert not any(map(Path.exists, own))
