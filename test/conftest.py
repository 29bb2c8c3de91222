"""Every test run has its own ROS domain, on this machine only; tests that this machine cannot run are skipped."""

import fcntl
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import long_tests
import pytest
from prerequisites import DATA, PREREQUISITES

FIRST_DOMAIN, DOMAINS = 51, 50
"""Those of demos lie below: one that a test starts must not hear what another test says."""


def domain_id() -> int:
    """A ROS domain for this process, one that no other test run on this machine has as long as both live."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    run, number = (os.getppid(), int(worker.removeprefix("gw"))) if worker else (os.getpid(), 0)
    domains = [FIRST_DOMAIN + (run + number + step) % DOMAINS for step in range(DOMAINS)]
    return next((domain for domain in domains if _is_free(domain)), domains[0])


def _is_free(domain: int) -> bool:
    """Whether no living process has this domain; this one then has it until it ends."""
    try:
        lock = os.open(Path(tempfile.gettempdir(), f"semantic_slam_test_domain_{domain}"), os.O_RDWR | os.O_CREAT)
    except OSError:  # another user's
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        return False
    return True


os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(domain_id())
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
# As in the nodes, and before NumPy is loaded: its threads wait for each other by spinning, and the matrices are small.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# So that their assertions show both sides when they fail.
pytest.register_assert_rewrite("semantic_slam.contracts", "worlds")


pytest_addoption = long_tests.add_option
pytest_collection_modifyitems = long_tests.leave_out


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what this machine cannot run, before fixtures try, and say what is missing."""
    for marker, reason in PREREQUISITES.items():
        if item.get_closest_marker(marker) and (missing := reason()):
            pytest.skip(missing)


@pytest.fixture
def data_set() -> Callable[[str], Path]:
    """Where a set of real data lies, by its folder's name; the test is skipped where only other sets do."""

    def folder(name: str) -> Path:
        path = Path(os.environ[DATA]) / name
        return path if path.is_dir() else pytest.skip(f"{path} is not there; {DATA} names a folder without {name}")

    return folder
